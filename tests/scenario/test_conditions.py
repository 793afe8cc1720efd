"""Expressions: values against Python's own arithmetic, dimensions, and the column of a fault."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, strategies as st

from cosim.core import InputError
from cosim.scenario import ExpressionError, formula
from cosim.scenario.binding import Meaning, bind
from cosim.scenario.expression import Expression
from cosim.scenario.quantity import Dimension, QuantityError, dimension, parse_quantity
from cosim.scenario.values import value_in


class Names:
    """x in metres, v in metres per second, a an angle, n without a unit, b a truth value."""

    known: ClassVar = {
        "p.x": Meaning("number", dimension(m=1)),
        "p.v": Meaning("number", dimension(m=1, s=-1)),
        "p.a": Meaning("number", dimension(rad=1)),
        "p.n[1,2]": Meaning("number", None),
        "p.b": Meaning("truth", None),
        "p.deg": Meaning("number", dimension(rad=1), lambda x: x * (math.pi / 180)),
        "sea-2.der(x)": Meaning("number", dimension(m=1)),
    }

    def meaning(self, reference: str) -> Meaning:
        if reference not in self.known:
            raise InputError.unknown("variable", reference, self.known)
        return self.known[reference]


def value(text: str, **values: float) -> bool:
    given = {"p.x": 3.0, "p.v": 0.5, "p.a": 0.3, "p.n[1,2]": 7.0, "p.b": 1.0, "t": 10.0}
    given |= {"p.deg": 90.0, "sea-2.der(x)": -1.0} | values
    bound = bind(Expression(text), Names())
    return bool(bound([given[name] for name in bound.names]))


@pytest.mark.parametrize(
    ("text", "true"),
    [
        ("p.x > 299 cm", True),
        ("p.x>=3 m and not p.x > 3 m", True),
        ("p.x > 5 m or t == 10 s", True),
        ("p.v < 1 kn", True),
        ("p.v*t == 5 m", True),
        ("p.x/t <= 0.3 m/s", True),
        ("abs(-p.x) == 3 and max(p.x, 4 m, 1) == 4", True),
        ("hypot(p.x, 4 m) == 5 m", True),
        ("sqrt(p.x**2) == p.x", True),
        ("p.n[1,2] ** 9 == 40353607 and p.n[1,2] ** -9 < 1e-7", True),
        ("p.n[1,2] < 1e-7", False),
        ("p.n[1,2] == 7e0 and p.n[1,2] == 70E-1 and 6.9e+0 < p.n[1,2] < 1e1", True),
        ("p.x == 3e0 m and p.x > 3e-7m", True),
        ("20 deg > p.a > 10 deg", True),
        ("p.n[1,2] - 7 == 0", True),
        ("p.b and p.n[1,2] != 2e0", True),
        ("p.deg > 1.57 rad and p.deg < 91 deg", True),
        ("'sea-2.der(x)' < 0 m", True),
        ("  min(1, 2) > 1", False),
        ("1 < 2 < 2", False),
        ("p.x / 0 > 1e300", True),
        ("sqrt(-p.x) > 0", False),
        ("p.x < 1e6", True),
        ("p.x<1E6 and p.x < 1e6 m", True),
        ("2e0 < p.x < 2e-3*1e+4", True),
        ("p.x > 1.5e-3", True),
        ("p.n[1,2] == .7e1", True),
        ("sin(p.a) ** 2 + cos(p.a) ** 2 - 1 < 1e-15", True),
        ("sin(0.1 rad/s * t) > 0.84 and sin(0.1 * t) > 0.84", True),
        ("exp(-t / 10 s) < 0.37 and log(exp(2)) == 2 and log(8, 2) == 3", True),
        ("atan2(p.x, p.x) == 45 deg and atan2(p.x, 3 m) > 0.78 rad and 2 * asin(1) == pi", True),
        ("round(p.v * t / 1 m) == 5 and floor(-p.x) == -3 and ceil(0.2) == 1", True),
        ("p.n[1,2] ** 10 == 282475249 and p.n[1,2] ** p.n[1,2] > 8e5", True),
        ("exp(1e4) > 1e300 and log(0) < -1e300", True),
        ("log(-1) < 0 or log(-1) >= 0", False),
        ("e > 2.7 and (p.x >\n 2 m)", True),
    ],
)
def test_condition_has_the_value_of_its_text(text: str, *, true: bool) -> None:
    """At one point, and the same over an array of points."""
    assert value(text) is true
    bound = bind(Expression(text), Names())
    one = {"p.x": 3.0, "p.v": 0.5, "p.a": 0.3, "p.n[1,2]": 7.0, "p.b": 1.0, "t": 10.0}
    one |= {"p.deg": 90.0, "sea-2.der(x)": -1.0}
    many = np.broadcast_to(bound([np.full(4, one[n]) for n in bound.names]), 4)
    assert many.tolist() == [true] * 4


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("p.x > > 5", 7, "cannot be understood"),
        ("p.x > 5 s", 7, "both in m; one is in s"),
        ("p.v + p.x > 0", 1, "both in m/s; one is in m"),
        ("t > 1 s and p.q > 5", 13, "there is no variable 'p.q'"),
        ("1 < 2 and q > 5", 11, "there is no variable 'q'"),
        ("p.x > 5 furlongz", 7, "furlongz"),
        ("p.x", 1, "this is a number"),
        ("p.x and p.b", 1, "neither true nor false"),
        ("p.b + 1 > 0", 1, "not a number"),
        ("exec(p.x) > 0", 1, "there is no function 'exec'"),
        ("p.x.__class__ > 0", 1, "p.x.__class__"),
        ("p.x > [1][0]", 7, "cannot contain this form"),
        ("p.x ** p.n[1,2] > 0", 8, "this exponent is not supported"),
        ("p.x ** 9.5 > 0", 8, "this exponent is not supported"),
        ("p.x ** -10 > 0", 8, "this exponent is not supported"),
        ("p.x := 3", 5, "cannot be understood"),
        ("p.a > 1 Hz", 7, "both in rad; one is in 1/s"),
        ("p.x > 1j", 7, "'j' is none"),
        ("p.x == 'text'", 8, "there is no variable 'text'"),
        ("", 1, "there is no condition"),
        ("p.x > 1 if p.b else 2", 1, "cannot contain this form"),
        ("p.x < 1e1234", 7, "out of range"),
        ("sin(p.x) > 0", 5, "sin takes an angle"),
        ("exp(p.a) > 0", 5, "exp takes a number without unit"),
        ("sin(t) > 0", 5, "this is in s"),
        ("p.a > atan2(p.x, p.v)", 18, "both in m; one is in m/s"),
        ("2 ** p.x > 0", 6, "this exponent is not supported"),
        ("sin() > 0", 1, "sin takes 1 values"),
        ("(1 > 0 and\n p.q > 5)", 13, "there is no variable 'p.q'"),
    ],
)
def test_fault_is_reported_with_its_column(text: str, column: int, words: str) -> None:
    """The column counts from 1, and a caret stands below it."""
    with pytest.raises(ExpressionError) as found:
        bind(Expression(text), Names())
    assert found.value.column == column
    assert words in str(found.value)
    assert found.value.got == text or (found.value.got or "").splitlines()[0] == text
    again = pickle.loads(pickle.dumps(found.value))  # noqa: S301 - written here
    assert (again.text(), again.column) == (found.value.text(), column)


NUMBERS = st.floats(-1e3, 1e3, allow_nan=False)


@given(a=NUMBERS, b=NUMBERS, c=NUMBERS)
def test_arithmetic_equals_that_of_python(a: float, b: float, c: float) -> None:
    """Any three numbers: sums, products and comparisons to the last bit."""
    text = "p.n[1,2] * 2 + p.n[1,2] - 0.5 * p.s >= abs(p.v) or p.x < -p.v and not p.s > p.n[1,2]"
    bound = bind(Expression(text), Loose())
    given = {"p.n[1,2]": a, "p.v": b, "p.x": c, "p.s": 1.5}
    expected = a * 2 + a - 0.5 * 1.5 >= abs(b) or (c < -b and not a < 1.5)
    assert bool(bound([given[n] for n in bound.names])) is expected


class Loose:
    """Numbers of no unit."""

    def meaning(self, reference: str) -> Meaning:
        del reference
        return Meaning("number", None)


@pytest.mark.parametrize(
    ("text", "si"),
    [
        ("50 ms", 0.05),
        ("2 kN", 2000.0),
        ("20 deg", math.radians(20)),
        ("3 kn", 3 * 1852 / 3600),
        ("60 rpm", 2 * math.pi),
        ("20 degC", 293.15),
        ("9.81 m/s2", 9.81),
        ("5 kN*m", 5000.0),
        ("-1.5e2 mm", -0.15),
        ("5 %", 0.05),
        ("35 km/h", 35 / 3.6),
        ("0.1 1/s", 0.1),
        ("1.1e1 1/s", 11.0),
        ("2e3mm", 2.0),
        ("1 kbit/s", 1000.0),
    ],
)
def test_quantity_is_what_the_tables_say(text: str, si: float) -> None:
    """Against the definitions: nautical mile 1852 m, minute 60 s, 0 degC 273.15 K."""
    assert parse_quantity(text).si == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "wanted", "si"),
    [
        ("1 s / 20", dimension(s=1), 0.05),
        ("2 * pi / 10 s", dimension(s=-1), 2.0 * math.pi / 10.0),
        ("sqrt(4) * 50 ms", dimension(s=1), 2.0 * 0.05),
        ("(1 + 2) ** 2", dimension(), 9.0),
    ],
)
def test_a_value_may_be_an_expression(text: str, wanted: Dimension, si: float) -> None:
    """Of numbers with units; no name is one, and a plain text is none."""
    assert value_in(text, wanted) == si
    for wrong, words in (
        (f"{text} * 1 kg", "a value in"),
        (f"{text} + x", "column"),
        ("soon", "as in"),
    ):
        with pytest.raises(QuantityError, match=words):
            value_in(wrong, wanted)


WHOLE_NUMBERS = ("1e6", "1e-3", "2.5E+3", "1e3/s", "51/s", "1e11/s", "1e1234 m")
"""Read up to some digit of theirs, the rest would be a unit."""


@pytest.mark.parametrize(
    "text", ["5", "m", "5 m s", "five m", "5 dB", "1e999 m", "5 m/", "5 N m", *WHOLE_NUMBERS]
)
def test_malformed_quantity_is_refused(text: str) -> None:
    """No unit, no number, two units without a sign, what is out of all range."""
    with pytest.raises(QuantityError):
        parse_quantity(text)


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("p.v ** 3", lambda x: x * x * x),
        ("p.v ** -2", lambda x: 1.0 / (x * x)),
        ("p.v ** 0 + 0 * p.v", lambda x: 1.0 + 0 * x),
    ],
)
def test_a_whole_power_is_made_of_products(text: str, exact: Callable[[Any], Any]) -> None:
    """The same bits on every processor; of a number of a study too."""
    values = np.array([0.1, -1.7, 3.3, 0.0, math.inf, 1e200])
    bound = bind(Expression(text), Loose(), "number")
    with np.errstate(all="ignore"):
        assert np.array_equal(bound([values]), exact(values), equal_nan=True)
    assert formula(text.replace("p.v", "x"), "x").number(x=1.7) == exact(1.7)


def test_another_power_is_that_of_the_c_library() -> None:
    """None raises for a signal: infinite, or not a number."""
    bound = bind(Expression("p.v ** 1.5"), Loose(), "number")
    values = (2.0, 0.0, math.inf, 1e300)
    assert [bound([x]) for x in values] == [math.pow(2.0, 1.5), 0.0, math.inf, math.inf]
    assert np.isnan(bound([-1.0]))
    assert bind(Expression("p.v ** -0.5"), Loose(), "number")([0.0]) == math.inf
    assert bind(Expression("p.v ** p.x"), Loose(), "number")([-2.0, 3.0]) == -8.0


_OF_X = (
    "0.1 * x + x * x",
    "x ** 0.5 / 3",
    "0.3 * sin(x) - exp(-x) * cos(x)",
    "max(x, 2) - round(x) + floor(x / 2) + tan(x)",
    "1.1 ** 3.5 * x",
)


@pytest.mark.parametrize("text", _OF_X)
@given(x=st.floats(0.0, 50.0))
def test_a_number_of_a_study_has_the_bits_of_python(text: str, x: float) -> None:
    """Functions and powers are those of the C library, as Python's; whole powers are products."""
    known = {name: getattr(math, name) for name in ("sin", "cos", "exp", "tan", "floor")}
    python = eval(text, known, {"x": x})  # noqa: S307 - one of these
    assert formula(text, "x").number(x=x).hex() == float(python).hex()


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("2 + 1 / x", 5, "division by zero"),
        ("1 - log(x - 1)", 5, "outside its domain"),
        ("exp(1e4 + x)", 1, "out of range"),
        ("(x - 1) ** 0.5", 1, "root of a negative number"),
        ("1e308 * (10 + x)", 1, "the value is inf"),
    ],
)
def test_a_number_that_does_not_exist_is_an_error_with_its_column(
    text: str, column: int, words: str
) -> None:
    """It names the operation that has no value, and x."""
    with pytest.raises(ExpressionError, match=r"x = 0\.0") as found:
        formula(text, "x").number(x=0.0)
    assert found.value.column == column
    assert words in str(found.value)
