"""FMI 3.0 around the same core: the same bits as FMI 2.0, and its own rules."""

from __future__ import annotations

import ctypes
import math
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import fmpy
import numpy as np
import pytest
from driven import DRIVE, drive, started
from fmpy import fmi3, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException

from cosim.fmu.export import CATALOGUE

if TYPE_CHECKING:
    from collections.abc import Callable

NAMES = sorted(CATALOGUE)
DISCARD, ERROR = 2, 3


class RawFmu3:
    """One instance through fmpy's FMI 3.0, with its log."""

    def __init__(self, path: Path) -> None:
        self.model = read_model_description(str(path))
        self.reference = {v.name: v.valueReference for v in self.model.modelVariables}
        self.logged: list[tuple[int, str]] = []
        self._folder = tempfile.mkdtemp()
        fmpy.extract(str(path), unzipdir=self._folder)
        self.fmu: Any = fmi3.FMU3Slave(
            guid=self.model.guid,
            unzipDirectory=self._folder,
            modelIdentifier=self.model.coSimulation.modelIdentifier,
            instanceName="it",
        )
        self.callback = fmi3.fmi3LogMessageCallback(self._log)
        self.instantiate()

    def instantiate(self, **options: bool) -> None:
        """Ask for an instance."""
        self.fmu.instantiate(loggingOn=True, logMessage=self.callback, **options)

    def _log(self, _env: int, status: int, _category: bytes, text: bytes) -> None:
        self.logged.append((status, text.decode()))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.freeInstance()
        shutil.rmtree(self._folder)

    def initialise(self, values: dict[str, float], start: float = 0.0) -> Self:
        """Set Reals and pass through initialization mode."""
        self.put(values)
        self.fmu.enterInitializationMode(startTime=start)
        self.fmu.exitInitializationMode()
        return self

    def put(self, values: dict[str, float]) -> None:
        """Write Reals by name."""
        self.fmu.setFloat64([self.reference[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Read Reals by name."""
        return list(self.fmu.getFloat64([self.reference[name] for name in names]))

    def step(self, t: float, h: float) -> tuple[Any, ...]:
        """Advance from t by h [s]."""
        return tuple(self.fmu.doStep(currentCommunicationPoint=t, communicationStepSize=h))

    def outputs(self) -> list[str]:
        """Names of the outputs."""
        return [v.name for v in self.model.modelVariables if v.causality == "output"]

    @property
    def messages(self) -> str:
        """Everything logged, one per line."""
        return "\n".join(text for _, text in self.logged)


def begun(folder: Path, name: str) -> RawFmu3:
    return RawFmu3(folder / f"{name}.fmu").initialise(dict(DRIVE[name][2]))


def attempt(call: Callable[..., Any], *arguments: Any) -> int | None:
    try:
        call(*arguments)
    except FMICallException as error:
        return int(error.status)
    return None


@pytest.mark.parametrize("name", NAMES)
def test_same_bits_as_fmi2(native_fmus: Path, native_fmus_of_fmi3: Path, name: str) -> None:
    """Driven alike, both versions give one result; time is a variable here."""
    with started(native_fmus, name) as old, begun(native_fmus_of_fmi3, name) as new:
        expected = drive(old, name, 0, 40)
        assert drive(new, name, 0, 40) == expected  # type: ignore[arg-type]
        assert new.get("time") == [39 * 0.05 + 0.05]
        assert new.messages == ""


@pytest.mark.parametrize("name", NAMES)
def test_every_fmu_runs_in_simulate_fmu(native_fmus_of_fmi3: Path, name: str) -> None:
    """fmpy's own master runs each from its defaults."""
    result = simulate_fmu(str(native_fmus_of_fmi3 / f"{name}.fmu"), stop_time=1.0)
    assert result["time"][-1] == pytest.approx(1.0)
    assert all(np.isfinite(result[column]).all() for column in result.dtype.names)


@pytest.mark.parametrize("name", NAMES)
def test_saved_state_goes_on_bit_for_bit(native_fmus_of_fmi3: Path, name: str) -> None:
    """In place, and over to a fresh instance as bytes."""
    with (
        begun(native_fmus_of_fmi3, name) as raw,
        RawFmu3(native_fmus_of_fmi3 / f"{name}.fmu") as fresh,
    ):
        drive(raw, name, 0, 17)  # type: ignore[arg-type]
        state = raw.fmu.getFMUState()
        data = raw.fmu.serializeFMUState(state)
        onward = drive(raw, name, 17, 30)  # type: ignore[arg-type]
        raw.fmu.setFMUState(state)
        assert drive(raw, name, 17, 30) == onward  # type: ignore[arg-type]
        other = fresh.fmu.deserializeFMUState(data)
        fresh.fmu.setFMUState(other)
        assert drive(fresh, name, 17, 30) == onward  # type: ignore[arg-type]
        raw.fmu.freeFMUState(state)
        fresh.fmu.freeFMUState(other)


REFUSED: dict[str, tuple[Callable[[RawFmu3], Any], str]] = {
    "NaN": (lambda r: r.put({"u[1]": math.nan}), "u[1] must be finite"),
    "time": (lambda r: r.fmu.setFloat64([r.reference["time"]], [1.0]), "time cannot be written"),
    "reference": (lambda r: r.fmu.getFloat64([9999]), "value reference 9999 is unknown"),
    "late parameter": (lambda r: r.put({"A[1,1]": 2.0}), "is a fixed parameter"),
    "values": (lambda r: r.fmu.setFloat64([1, 2], [1.0, 2.0, 3.0]), "3 values for 2 scalar"),
    "type": (lambda r: r.fmu.setInt32([1], [1]), "is of type Real, not Integer"),
    "other type": (lambda r: r.fmu.getUInt8([1]), "is of type Real, not UInt8"),
    "event mode": (lambda r: r.fmu.enterEventMode(), "this FMU has no event mode"),
    "step mode": (lambda r: r.fmu.enterStepMode(), "there is no event mode to come from"),
    "clock": (
        lambda r: r.fmu.fmi3GetClock(
            r.fmu.component, (ctypes.c_uint * 1)(1), 1, (ctypes.c_bool * 1)()
        ),
        "not Clock",
    ),
    "configuration": (
        lambda r: r.fmu.enterConfigurationMode(),
        "this FMU has no structural parameters",
    ),
    "step from elsewhere": (lambda r: r.step(3.0, 0.1), "but the instance is at 0.0 s"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_wrong_calls_are_refused_with_a_message(native_fmus_of_fmi3: Path, case: str) -> None:
    """Status and message; the instance is failed until it is reset."""
    abuse, message = REFUSED[case]
    with RawFmu3(native_fmus_of_fmi3 / "DelayedPlant.fmu").initialise({}) as raw:
        assert attempt(abuse, raw) == ERROR
        assert message in raw.messages
        assert attempt(raw.step, 0.0, 0.1) == ERROR
        raw.fmu.reset()
        raw.initialise({})
        raw.step(0.0, 0.1)
        assert raw.get("x[1]") == pytest.approx([5.275960814032278], rel=1e-9)


def test_stop_time_is_honoured(native_fmus_of_fmi3: Path) -> None:
    """FMI 3.0, 2.3.2: past it an error; a stop before the start is refused."""
    with RawFmu3(native_fmus_of_fmi3 / "DelayedPlant.fmu") as raw:
        raw.fmu.enterInitializationMode(startTime=0.0, stopTime=0.1)
        raw.fmu.exitInitializationMode()
        raw.step(0.0, 0.1)
        assert attempt(raw.step, 0.1, 0.1) == ERROR
        assert "ends at t = 0.2 s, after the stop time of 0.1 s" in raw.messages
        raw.fmu.reset()
        begin = raw.fmu.enterInitializationMode
        assert attempt(lambda: begin(startTime=1.0, stopTime=0.5)) == ERROR
        assert "must not be before the start time, 1.0 s" in raw.messages


def test_discarded_step_returns_the_last_successful_time(native_fmus_of_fmi3: Path) -> None:
    """The instance stays at that time."""
    with RawFmu3(native_fmus_of_fmi3 / "DelayedPlant.fmu").initialise({"A[1,1]": 5000.0}) as raw:
        flags = [ctypes.c_bool(True) for _ in range(3)]  # noqa: FBT003
        last = ctypes.c_double(-1.0)
        status = attempt(
            raw.fmu.fmi3DoStep,
            raw.fmu.component,
            0.0,
            1.0,
            False,  # noqa: FBT003
            *(ctypes.byref(flag) for flag in flags),
            ctypes.byref(last),
        )
        assert status == DISCARD
        assert last.value == 0.0
        assert not any(flag.value for flag in flags)
        assert raw.get("x[1]", "time") == [10.0, 0.0]


def test_event_mode_and_other_kinds_are_refused(native_fmus_of_fmi3: Path) -> None:
    """The message says what the FMU supports."""
    with RawFmu3(native_fmus_of_fmi3 / "WaveField.fmu") as raw:
        kept = raw.fmu.component
        name, token = b"it", raw.model.guid.encode()
        visible, logging = ctypes.c_bool(), ctypes.c_bool()
        assert not raw.fmu.fmi3InstantiateModelExchange(
            name, token, None, visible, logging, None, raw.callback
        )
        assert "this FMU is for co-simulation" in raw.messages
        with pytest.raises(Exception, match=r"instantiate|NULL|None"):
            raw.instantiate(eventModeUsed=True)
        assert "no event mode" in raw.messages
        raw.fmu.component = kept


def test_derivatives_of_the_direct_outputs(native_fmus_of_fmi3: Path) -> None:
    """dz = D2 du + D1 dw, forwards and backwards; states do not follow inputs at once."""
    with RawFmu3(native_fmus_of_fmi3 / "DelayedPlant.fmu").initialise({}) as raw:
        outputs = [raw.reference[n] for n in ("z[1]", "z[2]", "x[1]")]
        inputs = [raw.reference[n] for n in ("u[1]", "w[1]")]
        change = raw.fmu.getDirectionalDerivative(outputs, inputs, [2.0, -1.0])
        assert list(change) == [3 * 2.0 - 4.0, -1 * 2.0 - 3.0, 0.0]
        back = (ctypes.c_double * 2)()
        raw.fmu.fmi3GetAdjointDerivative(
            raw.fmu.component,
            (ctypes.c_uint * 3)(*outputs),
            3,
            (ctypes.c_uint * 2)(*inputs),
            2,
            (ctypes.c_double * 3)(1.0, 10.0, 100.0),
            3,
            back,
            2,
        )
        assert list(back) == [3 - 10.0, 4 + 30.0]
