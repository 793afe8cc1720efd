"""Recorded equations become C that does the same operations in the same order."""

from __future__ import annotations

import math
import re
import string
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
import two_delays
from driven import started
from fmpy.fmi1 import FMICallException
from hypothesis import given, strategies as st
from raw_fmu import RawFmu

from cosim.fmu import build_fmu
from cosim.fmu.export import Variable
from cosim.models import auv
from cosim.tape import FIXED, Functions, Tape, run_constants, statements, tangents

VALUES = {"a": 1 / 3, "b": -7.1, "c": 1e-9, "d": 3.0}


def as_python(text: str) -> dict[str, float]:
    """Run emitted C as Python: assignments, + - * /, and calls are the same in both."""
    joined = re.sub(r"\n\s{8}", " ", text)
    lines = [line.strip().removeprefix("const double ").rstrip(";") for line in joined.splitlines()]
    scope: dict[str, Any] = {
        **VALUES,
        "power": lambda x, y: x**y,
        "lesser": min,
        "greater": max,
        "sin": math.sin,
    }
    exec("\n".join(lines), {}, scope)  # noqa: S102 - our own text
    return scope


TREES = st.recursive(
    st.sampled_from(["a", "b", "c", "d", 2, -0.1, 1e-300]),
    lambda inner: st.one_of(
        st.tuples(st.sampled_from("+-*/"), inner, inner),
        st.tuples(st.just("negate"), inner),
        st.tuples(st.just("sin"), inner),
        st.tuples(st.sampled_from(["min", "max"]), inner, inner),
    ),
    max_leaves=40,
)


def value(tree: Any, leaf: Any, ns: Any) -> Any:
    """Evaluate a tree over whatever its leaves are."""
    if not isinstance(tree, tuple):
        return leaf(tree)
    operation, *inner = tree
    operands = [value(part, leaf, ns) for part in inner]
    if operation == "negate":
        return -operands[0]
    if operation in ("sin", "min", "max"):
        return getattr(ns, operation)(*operands)
    left, right = operands
    return {
        "+": lambda: left + right,
        "-": lambda: left - right,
        "*": lambda: left * right,
        "/": lambda: left / right,
    }[operation]()


class Plain:
    """Functions of floats."""

    sin, min, max = staticmethod(math.sin), min, max


@given(st.lists(TREES, min_size=1, max_size=4))
def test_emitted_text_has_the_bits_of_python(trees: list[Any]) -> None:
    """Any expression: precedence, sharing and splitting change not a bit."""
    tape = Tape()
    symbols = {name: tape.symbol(name) for name in VALUES}
    roots, expected = [], []
    for tree in trees:
        try:
            number = value(tree, lambda leaf: VALUES.get(leaf, leaf), Plain)
            root = value(tree, lambda leaf: symbols.get(leaf, leaf), Functions(tape))
        except (ZeroDivisionError, OverflowError, ValueError):
            continue
        roots.append(root if hasattr(root, "place") else tape.constant(root))
        expected.append(float(number))
    text = statements(tape, [(f"out{i}", root) for i, root in enumerate(roots)])
    got = as_python(text)
    for i, number in enumerate(expected):
        assert float(got[f"out{i}"]).hex() == number.hex() or math.isnan(number), text


def test_order_of_operations_is_kept() -> None:
    """Nothing is sorted, regrouped or divided by way of a reciprocal."""
    tape = Tape()
    a, b, c, d = (tape.symbol(name) for name in "abcd")
    text = statements(tape, [("x", d + (b + a) - (c - a) / b / c + d * (b * a))])
    assert text == "    x = d + (b + a) - (c - a) / b / c + d * (b * a);\n"


def test_equal_operations_are_done_once() -> None:
    """Also where a sum or a product is written the other way round."""
    tape = Tape()
    a, b = tape.symbol("a"), tape.symbol("b")
    text = statements(tape, [("x", (a + b) * a), ("y", a * (b + a) + (b - a)), ("z", a - b)])
    assert text.count("a + b") == 1
    assert "b + a" not in text
    assert text.count(" - ") == 2


def test_parts_that_depend_on_parameters_alone_are_found() -> None:
    """The largest such parts that varying values use, not those inside them."""
    tape = Tape()
    p, q = tape.symbol("p", FIXED), tape.symbol("q", FIXED)
    x = tape.symbol("x")
    whole = p * q / 2
    found = run_constants(tape, [whole * x + p])
    assert found == [whole.place]


def test_branching_on_a_value_is_refused() -> None:
    """Recording one run covers only one branch."""
    tape = Tape()
    x = tape.symbol("x")
    for question in (lambda: bool(x), lambda: x < 1, lambda: x == 1, lambda: float(x)):
        with pytest.raises(TypeError, match="must not branch"):
            question()
    with pytest.raises(AttributeError, match="gamma"):
        Functions(tape).gamma(x)
    with pytest.raises(OverflowError):
        tape.constant(2**53 + 1)


NAMES = [
    string.printable[:95],
    "??/ ??= ??' \\n \\x41 \\",
    "/* // */ %s %n %d",
    *("".join(map(chr, range(first, first + 64))) for first in range(0xA0, 0x250, 64)),
    "é1 ß777 \N{ROCKET}0 \N{COMBINING DIAERESIS}a \N{CJK UNIFIED IDEOGRAPH-6DF1} \U0010fffd",
]


def test_any_text_is_in_c_what_it_was(tmp_path: Path) -> None:
    """As bytes of UTF-8, with nothing for the compiler to interpret: names, in messages."""
    named = [f"p{i} {text}" for i, text in enumerate(NAMES)]
    parameters = [Variable(name, "parameter", "a parameter") for name in named]
    spec = replace(two_delays.SPEC, variables=(*two_delays.SPEC.variables, *parameters))
    with RawFmu(build_fmu(spec, tmp_path, prebuilt=False)) as raw:
        for name in named:
            raw.logged.clear()
            with pytest.raises(FMICallException):
                raw.put({name: math.nan})
            escaped = name.replace("#", "##").replace("%", "%%")  # FMI 2.0.4, 2.1.5
            assert raw.messages == f"{escaped} must be finite, got nan"
            raw.fmu.reset()


def test_recorded_vehicle_is_the_symbolic_one() -> None:
    """A computer algebra system, run over the same lines, has the same function."""
    names = [*auv.TABLE_1, *(f"damping.{axis}" for axis in "uvwr")]
    tape = Tape()
    generator = np.random.default_rng(3)
    numbers = dict(zip(names, generator.uniform(0.5, 2.0, len(names)), strict=True))
    state, late, tau, wind = (generator.uniform(-1, 1, n).tolist() for n in (8, 4, 4, 4))
    moving = [*state, *late, *tau, *wind]

    def run(p: Any, x: list[Any], ns: Any) -> list[Any]:
        b = auv.thrust_map(p)
        return auv.vehicle_derivatives(x[:8], x[8:12], x[12:16], x[16:], p, b, ns)

    symbols = sympy.symbols(f"x:{len(moving)}")
    letters = {name: sympy.Symbol(f"p{i}") for i, name in enumerate(names)}
    values = {**dict(zip(symbols, moving, strict=True))}
    values.update({letters[name]: numbers[name] for name in names})
    exact = [float(e.evalf(30, subs=values)) for e in run(letters, list(symbols), sympy)]

    recorded = run(
        {name: tape.symbol(f"p{i}", FIXED) for i, name in enumerate(names)},
        [tape.symbol(f"x{i}") for i in range(len(moving))],
        Functions(tape),
    )
    text = statements(tape, [(f"out{i}", rate) for i, rate in enumerate(recorded)])
    scope: dict[str, Any] = {f"p{i}": numbers[name] for i, name in enumerate(names)}
    scope.update({f"x{i}": number for i, number in enumerate(moving)})
    scope.update({"power": lambda x, y: x**y, "sin": math.sin, "cos": math.cos})
    joined = re.sub(r"\n\s{8}", " ", text)
    lines = [line.strip().removeprefix("const double ") for line in joined.splitlines()]
    exec("\n".join(lines), {}, scope)  # noqa: S102 - our own text
    got = [scope[f"out{i}"] for i in range(8)]
    assert got == pytest.approx(exact, rel=1e-12)
    assert got == run(numbers, moving, math)


def test_tangent_is_the_derivative() -> None:
    """Against sympy: sums, differences, products, signs."""
    tape = Tape()
    names = "abcd"
    symbols = {name: tape.symbol(name) for name in names}

    def f(a: Any, b: Any, c: Any, d: Any) -> Any:
        return -(a * b - c) * (b + 2 * d) - a

    moved = tangents(
        tape,
        [f(*symbols.values()), symbols["d"] * symbols["d"]],
        {symbols[n].place: tape.symbol(f"d{n}") for n in "abc"},
    )
    assert moved[1] is None
    letters = sympy.symbols("a b c d")
    change = {"da": 0.3, "db": -1.7, "dc": 2.0}
    exact = sum(
        float(sympy.diff(f(*letters), letter).subs(VALUES)) * change[f"d{letter}"]
        for letter in letters[:3]
    )
    assert moved[0] is not None
    text = statements(tape, [("out", moved[0])])
    for name, number in change.items():
        text = text.replace(f"d{name[1]}", f"({number})") if name in text else text
    assert as_python(text)["out"] == pytest.approx(exact, rel=1e-13)
    with pytest.raises(NotImplementedError, match="sin"):
        tangents(tape, [Functions(tape).sin(symbols["a"])], {symbols["a"].place: symbols["a"]})


def test_directional_derivative_is_that_of_the_output(tmp_path: Any) -> None:
    """Of a nonlinear output, against a difference quotient; states follow no input at once."""
    path = build_fmu(two_delays.SPEC, tmp_path, prebuilt=False)
    with RawFmu(path) as raw:
        raw.initialise()
        raw.put({"push[1]": 0.4, "push[2]": -0.7})
        raw.step(0.0, 0.3)
        references = [raw.reference[n] for n in ("power", "x[1]")]
        inputs = [raw.reference[n] for n in ("push[1]", "push[2]")]
        change = raw.fmu.getDirectionalDerivative(references, inputs, [1.5, -0.5])
        h = 1e-6
        sides = []
        for sign in (1, -1):
            raw.put({"push[1]": 0.4 + sign * 1.5 * h, "push[2]": -0.7 - sign * 0.5 * h})
            sides.append(raw.get("power")[0])
        assert change[0] == pytest.approx((sides[0] - sides[1]) / (2 * h), rel=1e-8)
        assert change[1] == 0.0


def test_output_without_feedthrough_has_no_derivative(native_fmus: Any) -> None:
    """Of the vehicle's states by its forces."""
    with started(native_fmus, "AuvPlant") as raw:
        outputs = [raw.reference[n] for n in raw.outputs()]
        forces = [raw.reference[f"force.{axis}"] for axis in "xy"]
        assert raw.fmu.getDirectionalDerivative(outputs, forces, [1.0, 1.0]) == [0.0] * 8
