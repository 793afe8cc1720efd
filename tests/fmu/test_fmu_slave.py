"""One slave behind fmpy: its life cycle, its rows, its errors, and what it leaves behind."""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from cosim.errors import ComponentError, InputError
from cosim.fmu import Bundle, FmuSlave, describe_fmu


class Log:
    """Collects what a slave says."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def __call__(self, level: str, message: str) -> None:
        self.lines.append((level, message))


@pytest.fixture
def scratch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where slaves unpack, to see what they leave."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def slave(fmus: Path, name: str, log: Log | None = None) -> FmuSlave:
    return FmuSlave(describe_fmu(fmus / f"{name}.fmu"), name.lower(), log or Log())


def test_rows_go_in_and_come_out_in_the_order_of_the_ports(fmus: Path, scratch: Path) -> None:
    """Reals and Integers mixed in one row; close removes every file, twice is once."""
    with slave(fmus, "WaveField") as sea:
        ports = sea.description.ports
        mixed = Bundle(sea, [ports[n] for n in ("Hs", "seed", "Tp", "spectrum", "components")])
        mixed.write(np.array([2.5, 7.0, 9.0, 2.0, 12.0]))
        row = np.full(5, np.nan)
        mixed.read(row)
        assert row.tolist() == [2.5, 7.0, 9.0, 2.0, 12.0]
        assert len(list(scratch.iterdir())) == 1
        sea.initialise({}, 0.0, 1.0)
        sea.step(0.0, 0.5)
        sea.close()
    assert list(scratch.iterdir()) == []


def test_bundle_without_ports_does_nothing(fmus: Path, scratch: Path) -> None:
    """A component without inputs is written an empty row."""
    with slave(fmus, "WaveField") as sea:
        Bundle(sea, []).write(np.empty(0))
        Bundle(sea, []).read(np.empty(0))
    assert list(scratch.iterdir()) == []


def test_refused_step_is_a_component_error_in_its_words(fmus: Path, scratch: Path) -> None:
    """Component, file, call, and what the slave logged; the log sink has it too."""
    log = Log()
    with slave(fmus, "DelayedPlant", log) as plant:
        plant.initialise({}, 0.0, 1.0)
        Bundle(plant, [plant.description.ports["u[1]"]]).write(np.array([np.nan]))
        with pytest.raises(ComponentError) as caught:
            plant.step(0.0, 0.1)
        assert "component 'delayedplant' (DelayedPlant.fmu): step from t = 0 s failed" in str(
            caught.value
        )
        assert caught.value.got == "u[1] must be finite, got nan"
    assert ("error", "u[1] must be finite, got nan") in log.lines
    assert list(scratch.iterdir()) == []


def test_unknown_and_unsettable_parameters(fmus: Path, scratch: Path) -> None:
    """A name that does not exist, an output: bad input, before the slave is touched."""
    with slave(fmus, "AuvPlant") as auv:
        with pytest.raises(InputError, match=r"there is no variable 'delay\.e'"):
            auv.initialise({"delay.e": 1.0}, 0.0, 1.0)
        with pytest.raises(InputError, match="causality output"):
            auv.initialise({"eta.x": 1.0}, 0.0, 1.0)
    assert list(scratch.iterdir()) == []


def test_parameters_without_meaning_fail_the_initialisation(fmus: Path, scratch: Path) -> None:
    """The slave's reason comes through."""
    with slave(fmus, "AuvPlant") as auv, pytest.raises(ComponentError, match="mass plus added"):
        auv.initialise({"hydro.X_udot": 1.0}, 0.0, 1.0)
    assert list(scratch.iterdir()) == []


def test_fmu_without_a_binary_for_this_machine(fmus: Path, tmp_path: Path, scratch: Path) -> None:
    """Said as such, and nothing is left behind."""
    bare = tmp_path / "WaveField.fmu"
    with zipfile.ZipFile(fmus / "WaveField.fmu") as old, zipfile.ZipFile(bare, "w") as new:
        for name in old.namelist():
            if not name.startswith("binaries/"):
                new.writestr(name, old.read(name))
    with pytest.raises(ComponentError, match="the FMU cannot be loaded") as caught:
        FmuSlave(describe_fmu(bare), "sea", Log())
    assert "component 'sea'" in str(caught.value)
    assert list(scratch.iterdir()) == []


def test_fmu_whose_script_is_broken(fmus: Path, tmp_path: Path, scratch: Path) -> None:
    """An FMU that someone edited and broke is a component error, not a crash."""
    broken = tmp_path / "WaveField.fmu"
    with zipfile.ZipFile(fmus / "WaveField.fmu") as old, zipfile.ZipFile(broken, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name.startswith("resources/WaveField_") and name.count("/") == 1:
                content = b"raise RuntimeError('edited')\n"
            new.writestr(name, content)
    with pytest.raises(ComponentError, match="the FMU cannot be loaded"):
        FmuSlave(describe_fmu(broken), "sea", Log())
    assert list(scratch.iterdir()) == []
