"""Variables of every type of FMI 3.0 and 2.0: described, written, read, refused, resized."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from foreign.c_fmu import TYPES, c_fmu, every, talker

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuDescription, FmuSlave, describe_fmu


@pytest.fixture(scope="module")
def described(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 3.0 slave with variables of every type."""
    return describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path_factory.mktemp("every")))


@pytest.fixture(scope="module")
def talking(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 2.0 slave in C."""
    return describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path_factory.mktemp("talker")))


def silent(_level: str, _message: str, _category: str) -> None:
    """Ignore messages."""


def started(described: FmuDescription, **parameters: Any) -> FmuSlave:
    slave = FmuSlave(described, "it", silent)
    slave.initialise(parameters, 0.0, None)
    return slave


EXTREMES: dict[str, tuple[Any, Any]] = {
    **{
        f"{sign}Int{bits}": (
            (0, 2**bits - 1) if sign else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        )
        for sign in ("", "U")
        for bits in (8, 16, 32, 64)
    },
    "Float64": (-1.7976931348623157e308, 5e-324),
    "Float32": (float(np.finfo("f4").max), float(np.float32(-1e-45))),
    "Boolean": (True, False),
    "String": ("", "größer \N{GREEK SMALL LETTER PSI} 100 %s"),
}


@pytest.mark.parametrize("kind", TYPES)
def test_extremes_of_every_type_pass_through(described: FmuDescription, kind: str) -> None:
    """The least and the greatest of a type, to the last bit, in scalars and arrays."""
    low, high = EXTREMES[kind]
    with started(described, n=1) as slave:
        for value in (low, high):
            slave.write({f"{kind}.in": value})
            read = slave.read([f"{kind}.out"])[f"{kind}.out"]
            assert read == value
            assert type(read) is type(value)
        if kind != "Float64":
            slave.write({f"{kind}.row": [low, high]})
            assert slave.read([f"{kind}.reversed"]) == {f"{kind}.reversed": [high, low]}


def test_all_types_at_once_in_the_order_asked_for(described: FmuDescription) -> None:
    """One call per type, whatever the order of the names."""
    names = [f"{kind}.{which}" for which in ("in", "out") for kind in reversed(TYPES)]
    with started(described) as slave:
        slave.write({f"{kind}.in": EXTREMES[kind][1] for kind in TYPES})
        read = slave.read(names)
    assert list(read) == names
    assert all(read[f"{kind}.out"] == EXTREMES[kind][1] for kind in TYPES)


def test_infinities_and_nan_pass_through(described: FmuDescription) -> None:
    """Only the FMU may refuse them."""
    with started(described) as slave:
        for kind, value in itertools.product(("Float64", "Float32"), (math.inf, -math.inf)):
            slave.write({f"{kind}.in": value})
            assert slave.read([f"{kind}.out"])[f"{kind}.out"] == value
        slave.write({"Float32.in": math.nan})
        assert math.isnan(slave.read(["Float32.out"])["Float32.out"])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("Int8.in", 128, "a value that Int8 holds"),
        ("UInt64.in", -1, "a value that UInt64 holds"),
        ("UInt64.in", 2**64, "a value that UInt64 holds"),
        ("Float32.in", 1e39, "a value that Float32 holds"),
        ("Int32.in", 1.5, "an integer"),
        ("Int32.in", True, "an integer"),
        ("Int32.in", math.nan, "an integer"),
        ("Int32.in", "7", "an integer"),
        ("Float64.in", "7", "a number"),
        ("Float64.in", None, "a number"),
        ("Float64.in", [1.0], "a number"),
        ("Boolean.in", 2, "true or false"),
        ("String.in", 3, "a text"),
        ("String.in", "a\0b", "a text"),
        ("level", 2, "one of 1"),
        ("Float64.row", [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], "2 x 3"),
        ("Float64.row", [[1.0, 2.0, 3.0], [4.0, 5.0]], "2 x 3"),
        ("Float64.row", 1.0, "2 x 3"),
        ("Int8.row", [1, 2, 3], "2"),
        ("String.row", "ab", "2"),
        ("Int8.row", [1, 300], "a value that Int8 holds"),
        ("blob", b"x", "discrete output: never"),
        ("Float64.output", 1.0, "there is no variable"),
        ("Float64.out", 1.0, "continuous output: never"),
        ("n", 3, "fixed structuralParameter: before the initialisation"),
        ("end_at", 3.0, "fixed parameter: before the initialisation"),
        ("x", 3.0, "continuous output: before the initialisation and during"),
        ("time", 3.0, "continuous independent: never"),
    ],
)
def test_values_that_do_not_fit_are_refused(
    described: FmuDescription, name: str, value: object, message: str
) -> None:
    """Wrong type, range, shape or phase: refused before the slave is called; it goes on."""
    with started(described) as slave:
        before = slave.read(["Int16.out"])
        with pytest.raises(InputError) as caught:
            slave.write({"Int16.in": 7, name: value})
        assert message in str(caught.value)
        assert str(caught.value).startswith("component 'it': ")
        assert slave.read(["Int16.out"]) == before
        slave.step(0.0, 0.1)


def test_tunable_parameters_and_inputs_can_be_set_at_any_time(described: FmuDescription) -> None:
    """Before, during and after the initialisation; and a value that the slave discards."""
    slave = FmuSlave(described, "it", silent)
    with slave:
        slave.write({"gain": 2.0, "Int8.in": 1, "n": 4})
        assert slave.description.ports["Float64.row"].shape == (4, 3)
        slave.enter_initialisation(0.0, 1.0)
        assert slave.read(["Int8.out", "n"]) == {"Int8.out": 1, "n": 4}
        slave.write({"Int8.in": 2, "gain": 3.0, "x": 7.0})
        assert slave.read(["Int8.out", "x"]) == {"Int8.out": 2, "x": 7.0}
        slave.exit_initialisation()
        slave.write({"gain": 4.0})
        slave.step(0.0, 0.5)
        assert slave.read(["x", "state"]) == {"x": 9.0, "state": 9.0}
        with pytest.raises(ComponentError, match="setting gain returned fmi3Discard") as caught:
            slave.write({"gain": -1.0})
        assert caught.value.got == "the gain must not be negative"
        slave.step(0.5, 0.5)
        assert slave.read(["x"]) == {"x": 11.0}


def test_arrays_follow_structural_parameters(described: FmuDescription) -> None:
    """Describe and run with other lengths; the last index runs fastest, as in C."""
    longer = described.resized({"n": 4, "gain": 2.0})
    assert longer.ports["Float64.row"].shape == (4, 3)
    assert longer.ports["Float64.row"].start == (0.0,) * 12
    assert longer.ports["Float64.reversed"].shape == (3, 4)
    assert longer.ports["Float64.reversed"].size == 12
    assert longer.ports["Int8.row"].shape == (2,)
    assert described.resized({"gain": 2.0}) is described
    with pytest.raises(InputError, match="n is no length of an array"):
        described.resized({"n": 2.5})
    matrix = np.arange(12.0).reshape(4, 3)
    with started(described, n=4) as slave:
        for given in (matrix, matrix.tolist(), matrix.ravel()):
            slave.write({"Float64.row": np.zeros((4, 3))})
            slave.write({"Float64.row": given})
            assert slave.read(["Float64.reversed"])["Float64.reversed"] == matrix.T.tolist()
    assert described.ports["Float64.row"].shape == (2, 3)


def test_ports_of_fmi3(described: FmuDescription) -> None:
    """Meaning, function, C type, shape, start and alias of every kind of variable."""
    ports = described.ports
    assert described.version == "3.0"
    for kind in TYPES:
        port = ports[f"{kind}.in"]
        assert (port.getter_type, port.shape, port.size) == (kind, (), 1)
        expected = {"F": "float", "I": "int", "U": "int", "B": "bool", "S": "string"}[kind[0]]
        assert port.kind == expected
        digits = "".join(filter(str.isdigit, kind))
        c_type = {"bool": "u1", "string": "S"}.get(
            expected, f"{kind[0].lower()}{int(digits or 8) // 8}"
        )
        assert port.c_type == c_type
    assert ports["String.row"].start == ("a", "a")
    assert ports["Boolean.in"].start is False
    assert ports["Int8.row"].start == (0, 0)
    assert (ports["status"].minimum, ports["status"].maximum, ports["n"].maximum) == (0, 5, 8)
    assert (ports["level"].kind, ports["level"].getter_type) == ("int", "Int64")
    assert (ports["blob"].kind, ports["clock"].kind) == ("binary", "clock")
    assert ports["state"].reference == ports["x"].reference
    assert not ports["state"].feedthrough
    assert ports["Float64.out"].feedthrough
    flags = ("variable_step", "can_get_and_set_state", "can_serialize_state")
    assert all(getattr(described, flag) for flag in flags)
    assert not described.can_be_instantiated_only_once
    assert not described.needs_execution_tool
    assert not described.can_interpolate_inputs


def test_bytes_are_read_as_they_are(described: FmuDescription) -> None:
    """Zero and 255 among them."""
    with started(described) as slave:
        assert slave.read(["blob", "x"]) == {"blob": b"\x00\xff%", "x": 5.0}


def test_types_that_cannot_be_exchanged_are_reported(described: FmuDescription) -> None:
    """A Clock, which has no value; an unknown name with the nearest one."""
    with started(described) as slave:
        with pytest.raises(InputError, match="clock is of a type that cannot be exchanged"):
            slave.read(["x", "clock"])
        with pytest.raises(InputError, match=r"did you mean Float64\.out"):
            slave.read(["Float64.oot"])


def test_ignored_start_value_is_reported(described: FmuDescription) -> None:
    """An exact start that the slave does not start with is bad input."""
    with started(described, x=6.5) as slave:
        assert slave.read(["x"]) == {"x": 6.5}
    with FmuSlave(described, "it", silent) as slave:
        with pytest.raises(InputError, match="seven cannot be set") as caught:
            slave.initialise({"seven": 8.0}, 0.0, 1.0)
        assert caught.value.got == "it starts with 7.0, given [8.0]"


def test_types_of_fmi2(talking: FmuDescription) -> None:
    """Reals, Strings, Booleans, enumerations; a tunable enumeration keeps to its items."""
    ports = talking.ports
    assert talking.version == "2.0"
    moved = {name: (p.kind, p.getter_type, p.c_type, p.start) for name, p in ports.items()}
    assert moved == {
        "u": ("float", "Real", "f8", 0.0),
        "y": ("float", "Real", "f8", None),
        "greeting": ("string", "String", "S", "hello"),
        "reply": ("string", "String", "S", None),
        "mode": ("int", "Integer", "i4", 0),
        "b": ("bool", "Boolean", "i4", False),
        "level": ("int", "Integer", "i4", 1),
        "c": ("bool", "Boolean", "i4", None),
    }
    with started(talking) as slave:
        slave.write({"greeting": "grüß", "u": 0.25, "b": True, "level": 3})
        read = slave.read(["reply", "y", "c", "level"])
        assert read == {"reply": "grüß", "y": 0.25, "c": True, "level": 3}
        with pytest.raises(InputError, match="one of 1, 3"):
            slave.write({"level": 2})
        with pytest.raises(InputError, match="fixed parameter: before the initialisation"):
            slave.write({"mode": 2})
