"""An FMU that changes rounding and flush-to-zero does so for its own calls alone."""

from __future__ import annotations

import ctypes
import platform
from collections.abc import Callable
from pathlib import Path

import pytest
from arithmetic import is_usual, keeps_tiny_numbers, reads_to_nearest, rounds_to_nearest
from foreign.steered import CALLS, VERSIONS, parameters, steered_fmu

from cosim.fmu import (
    FmuDescription,
    FmuSlave,
    describe_fmu,
    restore_function,
    saved_float_mode,
)

pytestmark = pytest.mark.skipif(
    platform.machine().lower() not in {"x86_64", "amd64", "aarch64", "arm64"},
    reason="the FMU knows how to change the arithmetic of these processors only",
)
Fmus = dict[tuple[str, str], FmuDescription]


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    """The FMU of each version that changes the arithmetic where it is told, or at once."""
    folder = tmp_path_factory.mktemp("steered")
    return {
        (version, guid): describe_fmu(steered_fmu(folder, version, guid=guid))
        for version in VERSIONS
        for guid in ("steered", "changes")
    }


def calls_of(slave: FmuSlave) -> list[tuple[str, Callable[[], object]]]:
    """The calls of a slave's life, by the name that steered.c has for what they do."""
    return [
        ("enter", lambda: slave.enter_initialisation(0.0, 1.0)),
        ("exit", slave.exit_initialisation),
        ("step", lambda: slave.step(0.0, 0.25)),
        ("get", lambda: slave.read(["x"])),
        ("save", slave.snapshot),
        ("terminate", slave.close),
    ]


@pytest.mark.parametrize(
    "what", ["set", "enter", "exit", "step", "get", "save", "terminate", "free"]
)
@pytest.mark.parametrize("version", VERSIONS)
def test_arithmetic_is_as_before_after_every_call(steered: Fmus, version: str, what: str) -> None:
    """Each call of a slave's life in turn changes it; no number computed here notices."""
    assert is_usual()
    slave = FmuSlave(steered[version, "steered"], "it", silent)
    slave.set_start(parameters("nothing", 0, arithmetic=CALLS.index(what)))
    assert is_usual(), "after setting parameters"
    for name, call in calls_of(slave):
        call()
        assert is_usual(), f"after {name}"


@pytest.mark.parametrize("version", VERSIONS)
def test_arithmetic_is_as_before_after_instantiation_and_reset(steered: Fmus, version: str) -> None:
    """Both at the ends of a slave's life."""
    with FmuSlave(steered[version, "changes"], "it", silent):
        assert is_usual()
    with FmuSlave(steered[version, "steered"], "it", silent) as slave:
        slave.initialise(parameters("nothing", 0, arithmetic=CALLS.index("reset")), 0.0, 1.0)
        slave.reset()
        assert is_usual()


@pytest.mark.parametrize("version", VERSIONS)
def test_arithmetic_is_as_before_after_loading_and_unloading(version: str, tmp_path: Path) -> None:
    """Some compilers' -ffast-math changes it when a library is loaded."""
    loaded = "".join(
        f"\n__attribute__(({when}structor)) static void {when}(void) {{ change_arithmetic(); }}\n"
        for when in ("con", "de")
    )
    described = describe_fmu(steered_fmu(tmp_path, version, more=loaded))
    with FmuSlave(described, "it", silent):
        assert is_usual()
    assert is_usual()


def test_fmu_does_change_it(steered: Fmus) -> None:
    """Called at its address, by nobody who restores anything; else these tests would be vain."""
    with FmuSlave(steered["2.0", "steered"], "it", silent) as slave:
        slave.initialise(parameters("nothing", 0, arithmetic=CALLS.index("step")), 0.0, 1.0)
        step = ctypes.CFUNCTYPE(
            ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int
        )(slave.address("step"))

        restore = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)(restore_function)
        saved = saved_float_mode()
        try:
            step(slave.component, 0.0, 0.25, 1)
            found = rounds_to_nearest(), reads_to_nearest(), keeps_tiny_numbers()
        finally:
            restore(ctypes.addressof(saved))
        assert found == (False, False, False)
        assert is_usual()
