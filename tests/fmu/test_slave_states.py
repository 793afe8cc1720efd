"""States of slaves: saved, restored, freed, as bytes; and what cannot."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from foreign.c_fmu import c_fmu, every, talker

from cosim.core import InputError
from cosim.fmu import FmuSlave, describe_fmu


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


def outputs_of_steps(slave: FmuSlave, first: int, last: int) -> list[dict[str, float]]:
    """Outputs of the steps first to last - 1, with inputs that move."""
    ports = slave.description.ports.values()
    inputs = [p.name for p in ports if p.causality == "input"]
    outputs = [p.name for p in ports if p.causality == "output"]
    seen = []
    for k in range(first, last):
        slave.write({name: math.sin(k + j) for j, name in enumerate(inputs)})
        slave.step(k * 0.05, 0.05)
        seen.append(slave.read(outputs))
    return seen


@pytest.mark.parametrize("flavour", ["python", "native", "native-fmi3"])
def test_restored_slave_goes_on_bit_for_bit(
    fmus: Path, native_fmus: Path, native_fmus_of_fmi3: Path, flavour: str
) -> None:
    """After a detour, from bytes, and in another instance; delay lines included."""
    folder = {"python": fmus, "native": native_fmus, "native-fmi3": native_fmus_of_fmi3}[flavour]
    described = describe_fmu(folder / "AuvPlant.fmu")
    with FmuSlave(described, "one", silent) as one, FmuSlave(described, "two", silent) as two:
        one.initialise({}, 0.0, 10.0)
        two.initialise({}, 0.0, 10.0)
        outputs_of_steps(one, 0, 20)
        state = one.snapshot()
        content = one.serialise(state)
        onward = outputs_of_steps(one, 20, 40)
        one.restore(state)
        assert outputs_of_steps(one, 20, 40) == onward
        one.free(state)
        one.free(state)
        two.restore(two.deserialise(content))
        assert outputs_of_steps(two, 20, 40) == onward
        with pytest.raises(InputError, match="a state that was freed"):
            one.restore(state)
        with pytest.raises(InputError, match="a state of another slave"):
            one.restore(two.snapshot())


def test_step_declares_whether_a_state_may_be_restored(tmp_path: Path) -> None:
    """As long as a state is saved; those left at the end are freed."""
    lines = []
    described = describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path))
    with FmuSlave(described, "it", lambda *line: lines.append(line[1])) as slave:
        slave.initialise({}, 0.0, 1.0)
        slave.step(0.0, 0.5)
        assert slave.read(["size"]) == {"size": -0.5}
        state = slave.snapshot()
        slave.step(0.5, 0.5)
        assert slave.read(["size"]) == {"size": 0.5}
        slave.free(state)
        slave.step(1.0, 0.5)
        assert slave.read(["size"]) == {"size": -0.5}
        slave.snapshot()
        slave.snapshot()
    assert lines.count("a state is freed") == 3


def test_restored_state_restores_the_phase(tmp_path: Path) -> None:
    """A state saved during the initialisation returns to it."""
    described = describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path))
    with FmuSlave(described, "it", silent) as slave:
        slave.enter_initialisation(0.0, None)
        state = slave.snapshot()
        slave.exit_initialisation()
        slave.step(0.0, 0.5)
        slave.restore(state)
        slave.write({"x": 3.0})
        slave.exit_initialisation()
        assert slave.read(["x"]) == {"x": 3.0}


@pytest.mark.parametrize(
    ("flags", "capability"),
    [
        ("", "canGetAndSetFMUstate"),
        ('canGetAndSetFMUstate="true"', "canSerializeFMUstate"),
    ],
)
def test_fmu_that_cannot_restore_a_state_is_reported(
    tmp_path: Path, flags: str, capability: str
) -> None:
    """With its name and the missing capability."""
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(flags=flags), tmp_path))
    with FmuSlave(described, "it", silent) as slave:
        attempt = slave.snapshot if not flags else lambda: slave.deserialise(b"")
        with pytest.raises(InputError) as caught:
            attempt()
    assert "talker_fmi2.fmu" in str(caught.value)
    assert caught.value.expected == f"the capability {capability}"
