"""An installed package with prebuilt binaries for this machine, and the FMUs that it builds.

Its binaries are compiled by the system's compiler, under the name of the cross compiler that a
wheel is built with: their bits are those of what is compiled beside them.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from c_compiler import c_compiler
from shared import made_once

from cosim.fmu.compiled import write_manifest
from cosim.fmu.export import ComponentSpec, host

ROOT = Path(__file__).parents[1]
NO_COMPILER = {"CC": "no-such-compiler"}
"""Environment in which all that is compiled is prebuilt."""

_CROSS_COMPILER = """\
import os, sys
words = sys.argv[2:]  # after `cc`
at = words.index("-target")
os.execvp({command!r}, [*{words!r}, *words[:at], *words[at + 2:]])
"""
_BUILD = """\
import pickle, sys
from cosim.core import CosimError
from cosim.fmu import build_fmu
from cosim.fmu.export import component_module
component_module("hinf_controller.variables")  # what is pickled names modules of components
spec, folder, flavour = pickle.load(sys.stdin.buffer)
try:
    print(build_fmu(spec, folder, flavour))
except CosimError as error:
    print(error, file=sys.stderr)
    sys.exit(error.exit_code)
"""


def python(
    code: str,
    *arguments: str,
    packages: Sequence[Path] = (ROOT,),
    given: bytes = b"",
    folder: Path | None = None,
    **environment: str,
) -> subprocess.CompletedProcess[bytes]:
    """Run Python with packages before all others, in a folder; `given`: its standard input."""
    path = os.pathsep.join([*map(str, packages), *filter(None, sys.path)])
    return subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-P", "-c", code, *arguments],
        input=given,
        cwd=folder,
        env={**os.environ, **environment, "PYTHONPATH": path},
        capture_output=True,
        check=False,
    )


def cross_compiled(code: str, folder: Path) -> None:
    """Run Python in which the system's compiler is the cross compiler, for this machine alone.

    `code` finds the folder that it fills as `folder`.
    """

    def fake(place: Path) -> None:
        words = c_compiler()
        package = place / "ziglang"
        package.mkdir()
        (package / "__init__.py").touch()
        text = _CROSS_COMPILER.format(command=words[0], words=words)
        (package / "__main__.py").write_text(text)

    begin = "import sys; from pathlib import Path; folder = Path(sys.argv[1])\n"
    packages = [made_once("wheel/cross-compiler", fake), ROOT]
    done = python(begin + code, str(folder), packages=packages)
    assert done.returncode == 0, done.stderr.decode()


def binary_of(kind: str, version: str = "2.0") -> dict[str, bytes]:
    """The binary of a kind of behaviour and a version of FMI, by its place among the prebuilt."""
    code = "from cosim.fmu.export import host, write_binary\n"
    code += f"write_binary({kind!r}, {version!r}, folder, host())"
    return _files(made_once(f"wheel/{version}/{kind}", lambda it: cross_compiled(code, it)))


def _files(folder: Path) -> dict[str, bytes]:
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


def installed(folder: Path, files: Mapping[str, bytes]) -> Path:
    """The present package as if a wheel had brought it, with these files prebuilt.

    Its sources are links to those of the checkout.
    """
    package = folder / "cosim"
    (package / "prebuilt").mkdir(parents=True)
    for path in (ROOT / "cosim").iterdir():
        if path.name not in ("prebuilt", "components", "__pycache__"):
            (package / path.name).symlink_to(path)
    (package / "components").symlink_to(ROOT / "fmu_src")
    for name, content in files.items():
        place = package / "prebuilt" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    write_manifest(package / "prebuilt", [host().tuple_name])
    return folder


def prebuilt_fmu(
    spec: ComponentSpec, kind: str, folder: Path, version: str = "2.0"
) -> subprocess.CompletedProcess[bytes]:
    """Build the FMU of a component into `folder`, by a prebuilt binary of a kind; print its path.

    There is no compiler: it is built from that binary, or not at all.
    """
    wheel = installed(folder / f"wheel-{spec.name}-{version}", binary_of(kind, version))
    # a view of a mapping is not to be pickled
    plain = replace(spec, constants=dict(spec.constants), resources=dict(spec.resources))
    flavour = "native" if version == "2.0" else "native-fmi3"
    given = pickle.dumps((plain, folder, flavour))
    return python(_BUILD, packages=[wheel], given=given, **NO_COMPILER)


def tape_fmu(spec: ComponentSpec, kind: str, folder: Path, version: str = "2.0") -> Path:
    """The FMU of a component, whose binary is of this kind and reads its model."""
    done = prebuilt_fmu(spec, kind, folder, version)
    assert done.returncode == 0, done.stderr.decode()
    return Path(done.stdout.decode().strip())
