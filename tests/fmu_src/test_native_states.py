"""Saved states, resets, many instances and threads of native FMUs."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import pytest
from driven import DRIVE, drive, started
from raw_fmu import RawFmu

from cosim.fmu.export import CATALOGUE

NAMES = sorted(CATALOGUE)


@pytest.mark.parametrize("name", NAMES)
def test_saved_state_goes_on_bit_for_bit(native_fmus: Path, name: str) -> None:
    """Back in the same instance, and over to a fresh one: the same bits, delay line included."""
    with (
        started(native_fmus, name) as raw,
        RawFmu(native_fmus / f"{name}.fmu", "fresh") as fresh,
    ):
        drive(raw, name, 0, 17)
        data = raw.saved()
        state = raw.fmu.getFMUstate()
        outputs = raw.get(*raw.outputs())
        onward = drive(raw, name, 17, 40)
        assert onward[-1] != outputs
        after = raw.saved()
        raw.fmu.setFMUstate(state)
        assert raw.saved() == data
        assert raw.get(*raw.outputs()) == outputs
        assert drive(raw, name, 17, 40) == onward
        fresh.resume(data)
        assert fresh.get(*fresh.outputs()) == outputs
        assert drive(fresh, name, 17, 40) == onward
        assert fresh.saved() == raw.saved() == after
        raw.fmu.freeFMUstate(state)
        assert raw.messages == fresh.messages == ""


@pytest.mark.parametrize("name", NAMES)
def test_states_of_every_phase_can_be_saved(native_fmus: Path, name: str) -> None:
    """Before, during and after initialisation, and after the end."""
    with RawFmu(native_fmus / f"{name}.fmu") as raw:
        kept = [raw.saved()]
        raw.fmu.setupExperiment(startTime=2.0)
        raw.fmu.enterInitializationMode()
        kept.append(raw.saved())
        raw.fmu.exitInitializationMode()
        kept.append(raw.saved())
        raw.step(2.0, 0.1)
        raw.fmu.terminate()
        kept.append(raw.saved())
        outputs = raw.get(*raw.outputs())
        for data in reversed(kept):
            raw.resume(data)
            assert raw.saved() == data
        raw.resume(kept[1])
        raw.fmu.exitInitializationMode()
        raw.step(2.0, 0.1)
        assert raw.get(*raw.outputs()) == outputs
        assert raw.messages == ""


def test_states_replace_each_other(native_fmus: Path) -> None:
    """A long history goes into the place of a short one, and back again."""
    with started(native_fmus, "DelayedPlant") as raw:
        short = raw.saved()
        drive(raw, "DelayedPlant", 0, 200)
        long = raw.saved()
        assert len(long) > len(short)
        for _ in range(3):
            raw.resume(short)
            assert raw.saved() == short
            raw.resume(long)
            assert raw.saved() == long


def test_history_older_than_every_delay_is_dropped(native_fmus: Path) -> None:
    """The state of a long run is as large as that of a short one."""
    with started(native_fmus, "AuvPlant") as raw:
        drive(raw, "AuvPlant", 0, 30)
        early = len(raw.saved())
        drive(raw, "AuvPlant", 30, 3000)
        assert abs(len(raw.saved()) - early) < 0.2 * early


@pytest.mark.parametrize("name", NAMES)
def test_reset_starts_anew(native_fmus: Path, name: str) -> None:
    """After reset the parameters are the defaults and a run is that of a new instance."""
    with started(native_fmus, name) as raw, RawFmu(native_fmus / f"{name}.fmu") as fresh:
        drive(raw, name, 0, 7)
        raw.fmu.reset()
        assert raw.saved() == fresh.saved()
        raw.initialise()
        fresh.initialise()
        assert drive(raw, name, 0, 9) == drive(fresh, name, 0, 9)
        raw.fmu.terminate()
        raw.fmu.reset()
        raw.initialise(dict(DRIVE[name][2]))
        with started(native_fmus, name) as other:
            assert drive(raw, name, 0, 9) == drive(other, name, 0, 9)


@pytest.mark.parametrize("name", NAMES)
def test_instances_of_one_library_do_not_disturb_each_other(native_fmus: Path, name: str) -> None:
    """Three instances on one loaded library, stepped in turn, give what each gives alone."""
    with started(native_fmus, name) as first:
        library = first.fmu.dll
        alone = drive(first, name, 0, 12)
        with ExitStack() as stack:
            crowd = [
                stack.enter_context(started(native_fmus, name, f"{name}{i}", first))
                for i in range(3)
            ]
            assert {member.fmu.dll._handle for member in crowd} == {library._handle}
            for k in range(12):
                for member in crowd:
                    assert drive(member, name, k, k + 1) == [alone[k]], k
            drive(first, name, 12, 20)  # none the worse for its guests


def test_threads_do_not_disturb_each_other(native_fmus: Path) -> None:
    """Eight instances of one library, each stepped by a thread of its own, all at once."""
    with started(native_fmus, "AuvPlant") as raw:
        alone = drive(raw, "AuvPlant", 0, 400)

        def life(number: int) -> bool:
            with started(native_fmus, "AuvPlant", str(number), raw) as own:
                return drive(own, "AuvPlant", 0, 400) == alone

        with ThreadPoolExecutor(8) as pool:
            assert all(pool.map(life, range(8)))
