"""The components are loaded by folder: a checkout's `fmu_src`, an installed `cosim/components`."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import cosim
from cosim.core import InputError
from cosim.fmu.export import CATALOGUE, component_module

ROOT = Path(cosim.__file__).parents[1]
SCRIPT = """
import sys
from pathlib import Path
import cosim
from cosim.fmu.export import component_module
print(Path(component_module("auv_plant.variables").__file__).parents[1])
for flavour in ("native", "python"):
    print(cosim.build_fmu("HinfController", Path(sys.argv[1], flavour), flavour))
"""


def built_by(packages: Path, out: Path) -> list[Path]:
    """The folder of the components, and the FMUs, of the package that lies in `packages`."""
    done = subprocess.run(  # noqa: S603
        [sys.executable, "-c", SCRIPT, str(out)],
        capture_output=True,
        text=True,
        cwd=out,
        env=os.environ | {"PYTHONPATH": str(packages)},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [Path(line) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_an_installed_package_builds_the_same_fmus(tmp_path: Path) -> None:
    """Laid out as the wheel is, from `cosim/components`, byte for byte."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    targets = wheel["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert targets["packages"] == ["cosim"]
    assert targets["force-include"] == {"fmu_src": "cosim/components"}
    installed = tmp_path / "site"
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "cosim", installed / "cosim", ignore=ignored)
    shutil.copytree(ROOT / "fmu_src", installed / "cosim" / "components", ignore=ignored)
    folders = []
    for name, packages in (("installed", installed), ("checkout", ROOT)):
        (tmp_path / name).mkdir()
        folder, *fmus = built_by(packages, tmp_path / name)
        assert len(fmus) == 2
        folders.append(folder)
    assert folders == [installed / "cosim" / "components", ROOT / "fmu_src"]
    for path in (tmp_path / "installed").rglob("*.fmu"):
        other = tmp_path / "checkout" / path.relative_to(tmp_path / "installed")
        assert path.read_bytes() == other.read_bytes()


def test_missing_component_is_reported() -> None:
    """By the name of its module, or of the component to build."""
    with pytest.raises(ModuleNotFoundError, match="submarine"):
        component_module("submarine.variables")
    with pytest.raises(InputError, match="no component 'Submarine'"):
        cosim.build_fmu("Submarine")
    with pytest.raises(InputError, match="no flavour 'wasm'"):
        cosim.build_fmu(next(iter(CATALOGUE)), flavour="wasm")
