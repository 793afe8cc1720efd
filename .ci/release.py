"""Make a release in dist/: sdist, wheel, archive of FMUs and SSPs, SBOM, SHA256SUMS.

The wheel is built from the sdist. The SSPs are exported by the package in the wheel. Two runs give
the same bytes; SOURCE_DATE_EPOCH in the environment is the date of what carries one, by default
that of the last commit, or 1980 where there is none.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import os
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
DIST, PREBUILT = ROOT / "dist", ROOT / "build" / "prebuilt"
DATE = (1980, 1, 1, 0, 0, 0)
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
NAME = f"{PROJECT['name'].replace('-', '_')}-{PROJECT['version']}"


def main() -> None:
    """Make all files of a release and print their sums."""
    shutil.rmtree(DIST, ignore_errors=True)
    environment = {
        **os.environ,
        "SOURCE_DATE_EPOCH": os.environ.get("SOURCE_DATE_EPOCH") or commit_time(),
        "AUV_COSIM_PREBUILT": str(PREBUILT),
        "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
    }
    run(sys.executable, "-m", "build", "--outdir", str(DIST), str(ROOT), env=environment)
    with tempfile.TemporaryDirectory(prefix="cosim-release-") as scratch:
        write_archive(Path(scratch), DIST / f"{NAME}-fmus.zip")
        write_sbom(Path(scratch), DIST / f"{NAME}.cdx.json")
    sums = [f"{sha256(path)}  {path.name}\n" for path in sorted(DIST.iterdir())]
    (DIST / "SHA256SUMS").write_text("".join(sums), "utf-8", newline="\n")
    print("".join(sums), end="")


def write_archive(scratch: Path, archived: Path) -> None:
    """Write the native FMUs, and the built-in scenarios as SSP, links as FMUs where they can be."""
    with zipfile.ZipFile(next(DIST.glob("*.whl"))) as wheel:
        wheel.extractall(scratch / "package")
    files = {
        f"fmus/{path.parent.name}/{path.name}": path.read_bytes()
        for path in (scratch / "package" / "cosim" / "prebuilt").glob("native*/*.fmu")
    }
    package = {**os.environ, "PYTHONPATH": str(scratch / "package"), "CC": "none"}
    scenarios = scratch / "package" / "cosim" / "scenario" / "library"
    for name in sorted(path.stem for path in scenarios.glob("*.toml")):
        target = scratch / f"{name}.ssp"
        for links in ("fmu", "annotate"):
            words = ("ssp", "export", name, "--links", links, "-o", str(target))
            refusal = output(sys.executable, "-m", "cosim", *words, cwd=scratch, env=package)
            if refusal is None:
                files[f"ssps/{name}.ssp"] = target.read_bytes()
                break
            print(f"{name}: no SSP with --links {links}: {refusal}")
    files["LICENSE"] = (ROOT / "LICENSE").read_bytes()
    with zipfile.ZipFile(archived, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, DATE)
            info.create_system, info.external_attr = 3, 0o100644 << 16
            archive.writestr(info, files[name])


def write_sbom(scratch: Path, target: Path) -> None:
    """Write what an installation brings, in the versions of this environment, as CycloneDX."""
    pinned = [f"{name}=={version}\n" for name, version in sorted(dependencies().items())]
    requirements = scratch / "requirements.txt"
    requirements.write_text("".join(pinned), "utf-8")
    command = ("-m", "cyclonedx_py", "requirements", "--output-reproducible", "--output-format")
    about = ("--pyproject", str(ROOT / "pyproject.toml"), "--mc-type", "application")
    run(sys.executable, *command, "JSON", *about, "-o", str(target), str(requirements))


def dependencies() -> dict[str, str]:
    """Return by name the version of each package that the package needs, directly or not."""
    found: dict[str, str] = {}
    ahead = [Requirement(text) for text in PROJECT["dependencies"]]
    while ahead:
        wanted = ahead.pop()
        name = canonicalize_name(wanted.name)
        if name in found or not is_wanted(wanted, ("",)):
            continue
        found[name] = importlib.metadata.version(name)
        needs = map(Requirement, importlib.metadata.requires(name) or ())
        ahead += [need for need in needs if is_wanted(need, ("", *wanted.extras))]
    return found


def is_wanted(requirement: Requirement, extras: tuple[str, ...]) -> bool:
    """Whether a requirement holds on this machine with one of the extras."""
    marker = requirement.marker
    return marker is None or any(marker.evaluate({"extra": extra}) for extra in extras)


def commit_time() -> str:
    """Return the time of the last commit [s since 1970]; 1980 without one."""
    command = ["git", "log", "-1", "--format=%ct"]
    try:
        done = subprocess.run(  # noqa: S603 - fixed words
            command, cwd=ROOT, check=True, capture_output=True, text=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "315532800"
    return done.stdout.strip()


def run(*command: str, cwd: Path = ROOT, env: dict[str, str] | None = None) -> None:
    """Run a command, and end with its output if it fails."""
    failure = output(*command, cwd=cwd, env=env)
    if failure is not None:
        sys.exit(f"{' '.join(command)}:\n{failure}")


def output(*command: str, cwd: Path = ROOT, env: dict[str, str] | None = None) -> str | None:
    """Run a command; return its output if it fails."""
    done = subprocess.run(  # noqa: S603 - our own tools
        command, cwd=cwd, env=env, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
    )
    return done.stdout.decode(errors="replace").strip() if done.returncode else None


def sha256(path: Path) -> str:
    """Return the hash of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    main()
