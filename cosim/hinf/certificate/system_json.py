"""A `DelaySystem` as JSON: the symbols of Eq. (7), every double kept bit for bit.

    {"name": "paper", "A": [[...]], "B": ..., "delays": [{"d": 0.3, "A": ..., "H": ...,
     "feedback": false, "any_age": false}]}

A delay whose age is known better has `least_age`, `rate` or `sampled` beside them. `feedback`
is a list of truth values, one per state, where only some states are fed back through a delay, or a
list of such lists, one per control, where entries of K act through different delays; so is
`feedback` beside `delays`, for x(t). `integrals` is the number of states, the last ones, that
the controller keeps as integrals of what it measures; no proof depends on it. A matrix without
entries is left out; its shape follows from the others. `uncertainty_blocks` has the columns of E
and rows of H of every block of F, [[1, 1], [2, 3]], where there are several.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.exact import format_value
from cosim.models import Delay, DelaySystem, Feedback, Matrix

MATRICES = ("A", "B", "C", "D", "D1", "D2", "E", "H")
"""The matrices of a system that do not belong to one delay."""

BLOCKS = "uncertainty_blocks"
"""The key of the sizes of the blocks of F."""

_FLAGS = ("feedback", "any_age", "sampled")
_TRUTHS = "true or false, or a list of them, one per state, or one such list per control"
_NO_HINTS: Mapping[str, str] = MappingProxyType({})
_HINTS = {"sampled": "the longest interval between two samples is d - least_age"}


def system_to_json(system: DelaySystem) -> dict[str, Any]:
    """Return `system` as JSON values; `system_from_json` gives the same doubles back."""
    matrices = {key: getattr(system, key).tolist() for key in MATRICES if getattr(system, key).size}
    delays = [
        {"d": x.d, "A": x.A.tolist()}
        | ({"H": x.H.tolist()} if x.H.size else {})
        | {"feedback": feedback_to_json(x.feedback), "any_age": x.any_age}
        | ({"least_age": x.least_age} if x.least_age else {})
        | ({} if x.rate is None else {"rate": x.rate})
        | ({"sampled": True} if x.sampled else {})
        for x in system.delays
    ]
    at_once: dict[str, Any] = {}
    if system.feedback is not None:
        at_once["feedback"] = feedback_to_json(system.feedback)
    at_once |= {"integrals": system.integrals} if system.integrals else {}
    if system.uncertainty_blocks is not None:
        at_once[BLOCKS] = [list(size) for size in system.uncertainty_blocks]
    return {"name": system.name, **matrices, "delays": delays, **at_once}


def feedback_to_json(feedback: Feedback) -> bool | list[Any]:
    """Return what is fed back as JSON: true, false, one truth value per state, or rows of them."""
    if isinstance(feedback, bool):
        return feedback
    return [own if isinstance(own, bool) else list(own) for own in feedback]


def system_from_json(data: Any, where: str = "system") -> DelaySystem:
    """Read the system that `system_to_json` wrote.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    keys = (*MATRICES, "name", "delays", "feedback", "integrals", BLOCKS)
    known_keys(data, where, keys, required=("A",))
    delays = data.get("delays", [])
    if not isinstance(delays, list):
        raise InputError(
            "not a list of delays", where=f"{where}.delays", expected="a list", got=_kind(delays)
        )
    n = len(data["A"]) if isinstance(data["A"], list) else 0
    terms = [delay_from(x, f"{where}.delays[{i}]", n) for i, x in enumerate(delays)]
    return assembled(data, terms, where)


def delay_from(data: Any, where: str, n: int) -> Delay:
    """Read one delayed term from its table; an absent A is the zero matrix (n, n)."""
    known = ("d", "A", "H", *_FLAGS, "least_age", "rate")
    known_keys(data, where, known, required=("d",))
    flags = {}
    for key in _FLAGS:
        flags[key] = data.get(key, False)
        several = key == "feedback" and is_truth_list(flags[key])
        if not isinstance(flags[key], bool) and not several:
            raise InputError(
                "not a truth value",
                where=f"{where}.{key}",
                expected=_TRUTHS if key == "feedback" else "true or false",
                got=format_value(flags[key]),
                hint=_HINTS.get(key),
            )
    A = matrix_from_rows(data["A"], f"{where}.A") if "A" in data else np.zeros((n, n))
    H = matrix_from_rows(data["H"], f"{where}.H") if "H" in data else None
    d = seconds(data["d"], f"{where}.d")
    ages: dict[str, Any] = {
        k: number(data[k], f"{where}.{k}") for k in ("least_age", "rate") if k in data
    }
    try:
        return Delay(d, A, H, **flags, **ages)
    except ValueError as error:
        raise refused(error, where) from error


def is_truth_list(value: Any) -> bool:
    """Whether a value from a file is a list of truth values, or of lists of them."""
    if not isinstance(value, list):
        return False
    if value and all(isinstance(row, list) for row in value):
        return all(isinstance(x, bool) for row in value for x in row)
    return all(isinstance(x, bool) for x in value)


def assembled(data: dict[str, Any], delays: list[Delay], where: str, name: str = "") -> DelaySystem:
    """Return the system of a table's matrices and `delays`; `name` unless the table has one.

    Raises
    ------
    InputError : not a name, not a matrix, or parts that do not fit together.
    """
    title = data.get("name", name)
    if not isinstance(title, str):
        raise InputError(
            "not a name", where=f"{where}.name", expected="a string", got=format_value(title)
        )
    matrices = {
        key: matrix_from_rows(data[key], f"{where}.{key}") for key in MATRICES if key in data
    }
    feedback = data.get("feedback")
    if feedback is not None and not is_truth_list(feedback):
        raise InputError(
            "not the states that are fed back at once",
            where=f"{where}.feedback",
            expected="a list of truth values, one per state, or one such list per control",
            got=format_value(feedback),
        )
    integrals = data.get("integrals", 0)
    if isinstance(integrals, bool) or not isinstance(integrals, int):
        raise InputError(
            "not a number of states",
            where=f"{where}.integrals",
            expected="how many of the states the controller keeps",
            got=format_value(integrals),
        )
    try:
        return DelaySystem(
            **matrices,
            delays=delays,
            name=title,
            feedback=feedback,
            integrals=integrals,
            uncertainty_blocks=_block_sizes(data[BLOCKS], where) if BLOCKS in data else None,
        )
    except ValueError as error:
        raise refused(error, where) from error


def _block_sizes(value: Any, where: str) -> list[list[int]]:
    """Read the columns of E and rows of H of every block of F."""

    def is_size(pair: Any) -> bool:
        whole = isinstance(pair, list) and len(pair) == 2
        return whole and all(isinstance(x, int) and not isinstance(x, bool) for x in pair)

    if not isinstance(value, list) or not all(is_size(pair) for pair in value):
        raise InputError(
            "not the blocks of the uncertainty F",
            where=f"{where}.{BLOCKS}",
            expected="a list of pairs, the columns of E and the rows of H of each block",
            got=format_value(value),
            hint="two parameters are [[1, 1], [1, 1]]",
        )
    return value


def known_keys(
    data: Any,
    where: str,
    known: tuple[str, ...],
    *,
    required: tuple[str, ...] = (),
    hints: Mapping[str, str] = _NO_HINTS,
) -> None:
    """Refuse anything but a table, an unknown key (naming the nearest known), a missing key.

    hints : what to do about keys that are often meant.
    """
    if not isinstance(data, dict):
        raise InputError("not a table of keys", where=where, expected="keys", got=_kind(data))
    for key in data:
        if key not in known:
            wrong = InputError.unknown("key", str(key), known, where=where)
            wrong.hint = hints.get(key, wrong.hint)
            wrong.args = (wrong.text(),)
            raise wrong
    for key in required:
        if key not in data:
            raise InputError(
                f"{key!r} is missing",
                where=where,
                expected=", ".join(required),
                got=", ".join(map(str, data)) or "nothing",
            )


def seconds(value: Any, where: str) -> float:
    """Read a time as `number`; a text with a unit is pointed out.

    Raises
    ------
    InputError : as `number`.
    """
    if isinstance(value, str):
        raise InputError(
            "not a finite number",
            where=where,
            expected="a finite number, in seconds",
            got=format_value(value),
            hint="without quotes and unit: 0.3 for 300 ms",
        )
    return number(value, where)


def refused(error: ValueError, where: str) -> InputError:
    """Return the refusal of a system's parts as an error with its parts apart."""
    found = _SHAPE.fullmatch(str(error))
    if found is None:
        return InputError(str(error), where=where)
    what, expected, got = found.groups()
    return InputError(what, where=where, expected=expected, got=got, hint=_SHAPES.get(what[0]))


_SHAPE = re.compile(r"(.*: wrong shape); expected (.*), got (.*)")
_BY_STATE = "one row per state: a column is [[4.0], [3.0]]"
_SHAPES = {
    "A": "one row and one column per state",
    "B": _BY_STATE,
    "C": _BY_STATE,
    "D": "one column per state: a row is [[4.0, 3.0]]",
    "E": _BY_STATE,
    "H": "one column per state: a row is [[4.0, 3.0]]",
}


def number(value: Any, where: str) -> float:
    """Read a finite double; an integer only if a double can represent it exactly.

    Raises
    ------
    InputError : anything else: text, a truth value, an infinity, a NaN.
    """
    wrong = InputError(
        "not a finite number", where=where, expected="a finite number", got=format_value(value)
    )
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise wrong
    try:
        as_double = float(value)
    except OverflowError as error:
        raise wrong from error
    if not np.isfinite(as_double) or as_double != value:
        raise wrong
    return as_double


def matrix_from_rows(value: Any, where: str) -> Matrix:
    """Read rows of equally many finite numbers as an array with two axes."""
    if not isinstance(value, list) or not all(isinstance(row, list) for row in value):
        raise InputError(
            "not a matrix",
            where=where,
            expected="a list of rows, each a list of numbers, as in [[1.0, 0.0], [0.0, 1.0]]",
            got=format_value(value),
            hint="a column is [[4.0], [3.0]]",
        )
    lengths = sorted({len(row) for row in value})
    if len(lengths) > 1:
        raise InputError(
            "rows of a matrix differ in length",
            where=where,
            expected="equally many numbers in every row",
            got=f"rows of {' and '.join(map(str, lengths))}",
        )
    entries = [
        [number(x, f"{where}[{i}][{j}]") for j, x in enumerate(row)] for i, row in enumerate(value)
    ]
    return np.array(entries, dtype=np.float64).reshape(len(value), lengths[0] if lengths else 0)


_CLOSE = 1e-9  # of E and H, relative: an older version computed them by BLAS


def first_difference(one: DelaySystem, other: DelaySystem) -> str | None:
    """Return where two systems differ, as `A[1,2]: 0.5 and 0.6`; None where they do not.

    Names are ignored; E and H must agree to a relative 1e-9, everything else exactly.
    """
    return next(differences(one, other, close=_CLOSE), None)


def _other_counts(one: DelaySystem, other: DelaySystem) -> str | None:
    """Return the numbers of states or of delays of two systems, if they differ."""
    for what, key in (("states", "A"), ("delays", "delays")):
        a, b = (len(getattr(system, key)) for system in (one, other))
        if a != b:
            return f"{what}: {a} and {b}"
    return None


def differences(one: DelaySystem, other: DelaySystem, *, close: float = 0.0) -> Iterator[str]:
    """Yield every place where two systems differ, as `A[1,2]: 0.5 and 0.6`; names are ignored.

    close : relative distance that entries of E and H may have.
    """
    counts = _other_counts(one, other)
    if counts is not None:
        yield counts
        return
    for kind in (("d", "feedback", "any_age"), ("least_age", "rate", "sampled")):
        facts = [
            [tuple(getattr(d, key) for key in kind) for d in system.delays]
            for system in (one, other)
        ]
        if facts[0] != facts[1]:
            yield f"delays ({', '.join(kind)}): {facts[0]} and {facts[1]}"
    for key in ("feedback", "integrals", BLOCKS):
        a, b = getattr(one, key), getattr(other, key)
        if a != b:
            yield f"{key}: {a} and {b}"
    pairs = {key: (getattr(one, key), getattr(other, key)) for key in MATRICES}
    for i, (a, b) in enumerate(zip(one.delays, other.delays, strict=True), 1):
        pairs |= {f"A{i}": (a.A, b.A), f"H{i}": (a.H, b.H)}
    for key, (a, b) in pairs.items():
        if a.shape != b.shape:
            yield f"{key}: {a.shape} and {b.shape} entries"
            continue
        allowed = (close if key[0] in "EH" else 0.0) * np.abs(b)
        for i, j in np.argwhere(np.abs(a - b) > allowed).tolist():
            yield f"{key}[{i + 1},{j + 1}]: {float(a[i, j])!r} and {float(b[i, j])!r}"


def _kind(value: Any) -> str:
    return type(value).__name__
