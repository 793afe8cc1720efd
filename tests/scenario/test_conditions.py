"""Expressions: values against Python's own arithmetic, dimensions, and the column of a fault.

Components with constant outputs stand for the names: p.x in metres, p.v in metres per second, p.a
an angle, p.n[1,2] without a unit, p.deg in degrees, q.Boolean.out a truth value; the time is 10 s.
"""

from __future__ import annotations

import math
import pickle
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from foreign.c_fmu import c_fmu, every
from hypothesis import given as drawn, strategies as st
from master.coupled import rewritten

from cosim.core import InputError
from cosim.fmu import build_fmu
from cosim.fmu.export import component_module
from cosim.scenario import (
    ExpressionError,
    FmuCache,
    Outcome,
    ScenarioPart,
    assembled_system,
    execute_unrecorded,
    formula,
    parse,
    prepare,
)

HEAD = """
title = "constants"
[run]
start = 10.0
end = 10.2
step = 0.1
[components.p]
fmu = "p.fmu"
[components.sea-2]
fmu = "sea.fmu"
[components.hull]
fmu = "AuvPlant"
parameters = { "damping.u" = DAMPING }
[components.q]
fmu = "every_fmi3.fmu"
parameters = { n = 1, "Boolean.in" = true }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs of the components."""
    made = tmp_path_factory.mktemp("constants")
    spec = component_module("signal_table.variables").table_spec
    outputs = [("x", "m"), ("v", "m/s"), ("a", "rad"), ("n[1,2]", None), ("deg", "s")]
    values = [3.0, 0.5, 0.3, 7.0, 90.0]
    plain = build_fmu(spec("Table", outputs, [0], [values], 0.1), made / "own", "native")
    deg = r'(name="deg"(?:(?!</ScalarVariable>)[\s\S])*?unit=")s"'
    rewritten(plain, made / "p.fmu", (deg, r'\1deg"'))
    sea = build_fmu(spec("Sea", [("der(x)", "m")], [0], [[-1.0]], 0.1), made / "own", "native")
    sea.replace(made / "sea.fmu")
    c_fmu("every_fmi3.c", every(), made)
    return made


def run_of(folder: Path, fmus: Path, *texts: str, damping: str = "0.1") -> Outcome:
    """A run in which conditions are asserted at its first point."""
    outcome, _ = execute_unrecorded(prepare(*given(folder, fmus, *texts, damping=damping)))
    return outcome


def given(folder: Path, fmus: Path, *texts: str, damping: str = "0.1") -> tuple[Any, FmuCache]:
    """The scenario of these conditions."""
    asserted = [{"always": text, "before": 10.0} for text in texts]
    data = tomllib.loads(HEAD.replace("DAMPING", damping)) | {"assertions": asserted}
    loaded = parse(tomli_w.dumps(data), name="c", where="c.toml", folder=folder)
    return loaded, FmuCache(fmus.parent, folder, flavour="native")


CONDITIONS = [
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
    ("q.Boolean.out and p.n[1,2] != 2e0", True),
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
]
"""Conditions, and whether they are true."""


@pytest.fixture(scope="module")
def judged(folder: Path, native_fmus: Path) -> dict[str, str]:
    """What a run says of each of them."""
    texts = [text for text, _ in CONDITIONS]
    found = run_of(folder, native_fmus, *texts).assertions
    return {text: one.result for text, one in zip(texts, found, strict=True)}


@pytest.mark.parametrize(("text", "true"), CONDITIONS)
def test_condition_has_the_value_of_its_text(
    text: str, *, true: bool, judged: dict[str, str]
) -> None:
    """At a point of a run, where each is asserted."""
    assert judged[text] == ("holds" if true else "fails")


@pytest.mark.parametrize(
    ("text", "column", "words"),
    [
        ("p.x > > 5", 7, "cannot be understood"),
        ("p.x > 5 s", 7, "both in m; one is in s"),
        ("p.v + p.x > 0", 1, "both in m/s; one is in m"),
        ("t > 1 s and p.q > 5", 13, "there is no variable 'p.q'"),
        ("1 < 2 and q > 5", 11, "there is no name 'q'"),
        ("p.x > 5 furlongz", 7, "furlongz"),
        ("p.x", 1, "this is a number"),
        ("p.x and q.Boolean.out", 1, "neither true nor false"),
        ("q.Boolean.out + 1 > 0", 1, "not a number"),
        ("exec(p.x) > 0", 1, "there is no function 'exec'"),
        ("p.x.__class__ > 0", 1, "p.x.__class__"),
        ("p.x > [1][0]", 7, "cannot contain this form"),
        ("p.x ** p.n[1,2] > 0", 8, "this exponent is not supported"),
        ("p.x ** 9.5 > 0", 8, "this exponent is not supported"),
        ("p.x ** -10 > 0", 8, "this exponent is not supported"),
        ("p.x := 3", 5, "cannot be understood"),
        ("p.a > 1 Hz", 7, "both in rad; one is in 1/s"),
        ("p.x > 1j", 7, "'j' is none"),
        ("p.x == 'text'", 8, "there is no name 'text'"),
        ("", 1, "there is no condition"),
        ("p.x > 1 if q.Boolean.out else 2", 1, "cannot contain this form"),
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
def test_fault_is_reported_with_its_column(
    text: str, column: int, words: str, folder: Path, native_fmus: Path
) -> None:
    """The column counts from 1, and a caret stands below it."""
    with pytest.raises(InputError) as found:
        assembled_system(prepare(*given(folder, native_fmus, text)))
    reported = found.value.text()
    assert "assertions[0].always" in reported
    assert f"column {column}" in reported
    assert words in reported
    if text and "\n" not in text:
        assert f"{text}\n       {' ' * (column - 1)}^" in reported


@pytest.mark.parametrize(("text", "column"), [("x > > 5", 5), ("1 + y", 5), ("1 / 0 m + 1 s", 1)])
def test_a_fault_is_the_same_in_another_process(text: str, column: int) -> None:
    """It is pickled with its words and its column."""
    with pytest.raises(ExpressionError) as found:
        formula(text, "x")
    assert found.value.column == column
    again = pickle.loads(pickle.dumps(found.value))  # noqa: S301 - written here
    assert (again.text(), again.column) == (found.value.text(), column)


def test_arithmetic_equals_that_of_python(native_fmus: Path, tmp_path: Path) -> None:
    """Any three numbers: sums, products and comparisons to the last bit."""
    text = "p.n * 2 + p.n - 0.5 * p.s >= abs(p.v) or p.x < -p.v and not p.s > p.n"
    draw = np.random.default_rng(5)
    rows = draw.uniform(-4.0, 4.0, (300, 3)).round(1).tolist()
    rows = [[*row, 1.5] for row in [*rows, [0.5, 0.75, -0.75], [0.5, -0.75, 0.0], [1.5, 9.0, 0.0]]]
    spec = component_module("signal_table.variables").table_spec
    outputs = [(name, None) for name in ("n", "v", "x", "s")]
    instants = [k * 100_000_000 for k in range(len(rows))]
    build_fmu(spec("Table", outputs, instants, rows, 0.1), tmp_path, "native")
    same = f"c.y > 0 and ({text}) or c.y < 1 and not ({text})"
    data = {
        "title": "arithmetic",
        "run": {"end": instants[-1] / 1e9, "step": 0.1},
        "components": {"p": {"fmu": "Table.fmu"}},
        "computed": {"c": {"y": text}},
        "assertions": [{"always": same}],
    }
    loaded = parse(tomli_w.dumps(data), name="a", where="a.toml", folder=tmp_path)
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    outcome, run = execute_unrecorded(prepare(loaded, cache))
    expected = [n * 2 + n - 0.5 * s >= abs(v) or (x < -v and not n < s) for n, v, x, s in rows]
    assert run.signal("c", "y").tolist() == [float(true) for true in expected]
    assert 30 < sum(expected) < 290
    assert outcome.assertions[0].result == "holds"


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
        ("2e3mm", 2.0),
        ("1 kbit/s", 1000.0),
    ],
)
def test_quantity_is_what_the_tables_say(text: str, si: float) -> None:
    """Against the definitions: nautical mile 1852 m, minute 60 s, 0 degC 273.15 K."""
    assert formula(text).number() == pytest.approx(si, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "si"), [("0.1 1/s", 0.1), ("1.1e1 1/s", 11.0), ("2 * pi / 10 s", 2.0 * math.pi / 10.0)]
)
def test_a_parameter_is_a_quantity_of_its_unit(
    text: str, si: float, folder: Path, native_fmus: Path
) -> None:
    """Of a rate of decay, in 1/s."""
    system, _ = assembled_system(prepare(*given(folder, native_fmus, damping=f'"{text}"')))
    assert system.components["hull"].parameters["damping.u"] == si


def step_of(text: str) -> float:
    """The step of a run that a scenario says with this text."""
    data = {"title": "t", "components": {"a": {"fmu": "A"}}}
    return float(
        ScenarioPart.model_validate({**data, "run": {"end": 100.0, "step": text}}).run.step
    )


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("1 s / 20", 0.05),
        ("sqrt(4) * 50 ms", 2.0 * 0.05),
        ("(1 + 2) ** 2 * 1 s", 9.0),
    ],
)
def test_a_value_may_be_an_expression(text: str, seconds: float) -> None:
    """Of numbers with units; no name is one, and a plain text is none."""
    assert step_of(text) == seconds
    for wrong, words in (
        (f"{text} * 1 kg", "a value in"),
        (f"{text} + x", "column"),
        ("soon", "as in"),
    ):
        with pytest.raises(ValueError, match=words):
            step_of(wrong)


WHOLE_NUMBERS = ("1e6", "1e-3", "2.5E+3", "1e3/s", "51/s", "1e11/s", "1e1234 m")
"""Read up to some digit of theirs, the rest would be a unit."""


@pytest.mark.parametrize(
    "text", ["5", "m", "5 m s", "five m", "5 dB", "1e999 m", "5 m/", "5 N m", *WHOLE_NUMBERS]
)
def test_malformed_quantity_is_refused(text: str, folder: Path, native_fmus: Path) -> None:
    """No unit, no number, two units without a sign, what is out of all range."""
    with pytest.raises(ValueError, match=r"as in|in range|none"):
        step_of(text)
    with pytest.raises(InputError, match=r"as in|in range|none"):
        assembled_system(prepare(*given(folder, native_fmus, damping=f'"{text}"')))


@pytest.mark.parametrize(
    ("text", "exact"),
    [
        ("x ** 3", lambda x: x * x * x),
        ("x ** -2", lambda x: 1.0 / (x * x)),
        ("x ** 0 + 0 * x", lambda x: 1.0 + 0 * x),
    ],
)
def test_a_whole_power_is_made_of_products(text: str, exact: Callable[[Any], Any]) -> None:
    """The same bits on every processor; of a number of a study too."""
    values = np.array([0.1, -1.7, 3.3, 0.0, math.inf, 1e200])
    bound = formula(text, "x")
    with np.errstate(all="ignore"):
        assert np.array_equal(bound([values]), exact(values), equal_nan=True)
    assert bound.number(x=1.7) == exact(1.7)


def test_another_power_is_that_of_the_c_library() -> None:
    """None raises for a signal: infinite, or not a number."""
    bound = formula("x ** 1.5", "x")
    values = (2.0, 0.0, math.inf, 1e300)
    assert [bound([x]) for x in values] == [math.pow(2.0, 1.5), 0.0, math.inf, math.inf]
    assert np.isnan(bound([-1.0]))
    assert formula("x ** -0.5", "x")([0.0]) == math.inf
    assert formula("x ** y", "x", "y")([-2.0, 3.0]) == -8.0


_OF_X = (
    "0.1 * x + x * x",
    "x ** 0.5 / 3",
    "0.3 * sin(x) - exp(-x) * cos(x)",
    "max(x, 2) - round(x) + floor(x / 2) + tan(x)",
    "1.1 ** 3.5 * x",
)


@pytest.mark.parametrize("text", _OF_X)
@drawn(x=st.floats(0.0, 50.0))
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
