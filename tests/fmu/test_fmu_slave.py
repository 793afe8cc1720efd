"""One slave: its life cycle, values and errors."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path

import pytest

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuSlave, describe_fmu


class Log:
    """Collects the messages of a slave."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def __call__(self, level: str, message: str, category: str) -> None:
        self.lines.append((level, message, category))


def slave(fmus: Path, name: str, log: Log | None = None) -> FmuSlave:
    return FmuSlave(describe_fmu(fmus / f"{name}.fmu"), name.lower(), log or Log())


def test_write_step_and_read(fmus: Path) -> None:
    """Reals and Integers in one call; closing twice does nothing more."""
    with slave(fmus, "WaveField") as sea:
        given = {"Hs": 2.5, "seed": 7, "Tp": 9.0, "spectrum": 2, "components": 12}
        sea.write(given)
        with pytest.raises(InputError, match="nothing can be read before the initialisation"):
            sea.read(["Hs"])
        sea.initialise({}, 0.0, 1.0)
        read = sea.read(given)
        assert read == given
        assert list(read) == list(given)
        assert [type(x) for x in read.values()] == [type(x) for x in given.values()]
        sea.step(0.0, 0.5)
        sea.close()


def test_refused_value_raises_component_error_with_the_logged_reason(fmus: Path) -> None:
    """It names component, file and call; the slave had returned OK; later calls are refused."""
    log = Log()
    with slave(fmus, "DelayedPlant", log) as plant:
        plant.initialise({}, 0.0, 1.0)
        with pytest.raises(ComponentError) as caught:
            plant.write({"u[1]": math.nan})
        assert "component 'delayedplant' (DelayedPlant.fmu): setting u[1] logged an error" in str(
            caught.value
        )
        assert caught.value.got == "u[1] must be finite, got nan"
        with pytest.raises(ComponentError, match="is called after the end"):
            plant.step(0.0, 0.1)
    assert ("error", "u[1] must be finite, got nan", "logStatusError") in log.lines


def test_refused_step_raises_component_error_with_the_logged_reason(fmus: Path) -> None:
    """PythonFMU reports a failed step by Discard, like a slave that asks for the end."""
    with slave(fmus, "DelayedPlant") as plant:
        plant.initialise({}, 0.0, 1.0)
        with pytest.raises(ComponentError, match=r"step from t = 5 s returned fmi2\w+") as caught:
            plant.step(5.0, 0.1)
        assert "the instance is at 0.0 s" in str(caught.value)


def test_unknown_and_unsettable_parameters(fmus: Path) -> None:
    """An unknown name or an output is bad input, refused before the slave is called."""
    with slave(fmus, "AuvPlant") as auv:
        with pytest.raises(InputError, match=r"there is no variable 'delay\.e'"):
            auv.initialise({"delay.e": 1.0}, 0.0, 1.0)
        with pytest.raises(InputError, match=r"eta\.x cannot be set") as caught:
            auv.initialise({"eta.x": 1.0}, 0.0, 1.0)
        assert "output" in str(caught.value)


def test_invalid_parameters_fail_the_initialisation(fmus: Path) -> None:
    """The error contains the slave's reason."""
    with slave(fmus, "AuvPlant") as auv, pytest.raises(ComponentError, match="mass plus added"):
        auv.initialise({"hydro.X_udot": 1.0}, 0.0, 1.0)


def test_fmu_whose_script_is_broken(fmus: Path, tmp_path: Path) -> None:
    """An FMU that someone edited and broke is a component error, not a crash."""
    broken = tmp_path / "WaveField.fmu"
    with zipfile.ZipFile(fmus / "WaveField.fmu") as old, zipfile.ZipFile(broken, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name.startswith("resources/WaveField_") and name.count("/") == 1:
                content = b"raise RuntimeError('edited')\n"
            new.writestr(name, content)
    with pytest.raises(ComponentError, match="the FMU refuses to be instantiated"):
        FmuSlave(describe_fmu(broken), "sea", Log())
