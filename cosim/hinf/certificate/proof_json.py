"""Proofs as JSON, exact numbers as "p/q": which names there are follows from the theorem.

Of Theorem 2, of a design and of its guarantees (the certificate of a design adds Y = K X):

    {"X": [["p/q", ...]], "Q": [...], "R": [...], "eps": ..., "k1": [...], "k2": [...],
     "gamma": ...}

Of an analysis: Q, R one matrix per positive delay, Q null where any age is allowed; "lower", where
it is given, is the least of each positive delay that the claim covers, null where any age is:

    {"order": 0, "P": [["p/q", ...]], "Q": [...], "R": [...], "eps": ..., "gamma": ...}

Of ages as they are, one of "terms" per positive delay; beside its matrices "states" or "controls",
numbers from 1, is its support; without it the terms are about the whole state:

    {"order": 1, "P": [["p/q", ...]], "eps": ..., "gamma": ..., "down_to_zero": false,
     "terms": [{"functional": "looped", "matrices": {"U": ..., "X_a": ...}}]}

eps is a list where F has several blocks; gamma is null where stability alone is proved.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast

from cosim.core import InputError, format_value
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.exact import exact, from_text, matrix_from_text, matrix_to_text, to_text
from cosim.hinf.theorems import (
    MAX_ORDER,
    UNKNOWNS,
    AgesTheorem,
    Proof,
    Shape,
    Support,
    Theorem2,
    constants_down_to_zero,
    positive_delays,
)
from cosim.models import DelaySystem, Matrix

Counts = Mapping[str, int | None]
"""Unknowns by name, and how many of each there are: name[0], name[1], ..; None: itself."""

_BLOCKS = ("eps", "eps_out")
"""One number per block of F: one stands for itself, none is null."""
_SUPPORTS = ("states", "controls")


def unknowns_to_json(unknowns: Mapping[str, Any], counts: Counts) -> dict[str, Any]:
    """Return the JSON values that `unknowns_from_json` reads; null where there is none."""
    table: dict[str, Any] = {}
    for name, count in counts.items():
        if count is None:
            table[name] = _to_json(unknowns.get(name))
            continue
        each = [_to_json(unknowns.get(f"{name}[{i}]")) for i in range(count)]
        alone = name in _BLOCKS and count < 2
        table[name] = (each[0] if each else None) if alone else each
    return table


def _blocks(unknowns: Mapping[str, Any]) -> int:
    return sum(name.startswith("eps[") for name in unknowns)


def _to_json(value: Any) -> Any:
    if value is None:
        return None
    return matrix_to_text(value) if hasattr(value, "nrows") else to_text(value)


def unknowns_from_json(
    data: Mapping[str, Any], shapes: Mapping[str, Shape], counts: Counts, where: str
) -> dict[str, Any]:
    """Read the unknowns of these shapes; messages name `where`.

    Raises
    ------
    InputError : a wrong length or shape, a text that is no number, or a value where there is none.
    """
    unknowns: dict[str, Any] = {}
    for name, count in counts.items():
        place = f"{where}.{name}"
        each = {name: (data[name], place)}
        if count == 1 and name in _BLOCKS:
            each = {f"{name}[0]": (data[name], place)}
        elif count is not None and (count or name not in _BLOCKS):
            values = data[name]
            if not isinstance(values, list) or len(values) != count:
                raise InputError(
                    f"not one per {'block of F' if name in _BLOCKS else 'delay'}",
                    where=place,
                    expected=f"a list of {count}",
                    got=format_value(values),
                )
            each = {f"{name}[{i}]": (value, f"{place}[{i}]") for i, value in enumerate(values)}
        for key, (value, at) in each.items():
            shape = shapes.get(key)
            check_null(value, at, expected=shape is None)
            if shape is not None:
                unknowns[key] = (
                    from_text(value, at)
                    if shape.is_number
                    else matrix_from_text(value, at, shape.height, shape.width)
                )
    return unknowns


def check_null(value: Any, where: str, *, expected: bool) -> None:
    """Refuse a value where null is `expected`, and null where a value is.

    Raises
    ------
    InputError : naming `where`.
    """
    if (value is None) != expected:
        raise InputError(
            "does not fit the system",
            where=where,
            expected="null" if expected else "a value",
            got=format_value(value),
        )


def numbers_from_json(data: Any, count: int, where: str) -> tuple[Any, ...]:
    """Read a list of so many "p/q" as `fmpq`.

    Raises
    ------
    InputError : another length, a text that is no number.
    """
    if not isinstance(data, list) or len(data) != count:
        raise InputError(
            "wrong length",
            where=where,
            expected=f"a list of {count}",
            got=format_value(data),
        )
    return tuple(from_text(x, f"{where}[{i}]") for i, x in enumerate(data))


def numbers_to_json(values: tuple[Any, ...]) -> list[str]:
    """Return what `numbers_from_json` reads."""
    return [to_text(value) for value in values]


# ---- Theorem 2


THEOREM_2_KEYS = ("X", "Q", "R", "eps", "k1", "k2", "gamma")


def _counts_of_theorem_2(delays: int, blocks: int) -> Counts:
    return {"X": None, "Q": delays, "R": delays, "eps": blocks, "gamma": None}


def theorem_2_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `theorem_2_from_json` reads."""
    theorem = cast("Theorem2", proof.theorem)
    counts = _counts_of_theorem_2(len(theorem.k1), _blocks(proof.unknowns))
    scalars = {"k1": numbers_to_json(theorem.k1), "k2": numbers_to_json(theorem.k2)}
    return {**unknowns_to_json(proof.unknowns, counts), **scalars}


def theorem_2_from_json(
    system: DelaySystem, gain: Matrix, data: Any, where: str, *, bounded: bool
) -> Proof:
    """Read a proof by Theorem 2 that `theorem_2_to_json` wrote; `bounded` : with a gamma.

    Raises
    ------
    InputError : a missing key, a wrong shape, a text that is no number.
    """
    known_keys(data, where, THEOREM_2_KEYS, required=THEOREM_2_KEYS)
    N = len(system.delays)
    k1, k2 = (numbers_from_json(data[name], N, f"{where}.{name}") for name in ("k1", "k2"))
    theorem, counts = Theorem2(k1, k2), _counts_of_theorem_2(N, len(system.blocks))
    shapes = theorem.shapes(system, gain, bounded=bounded)
    return Proof(theorem, unknowns_from_json(data, shapes, counts, where))


# ---- given ages


def _counts_of_analysis(delays: int, blocks: int) -> Counts:
    return {"P": None, "Q": delays, "R": delays, "eps": blocks, "gamma": None}


def analysis_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `analysis_from_json` reads."""
    theorem = cast("AgesTheorem", proof.theorem)
    counts = _counts_of_analysis(len(theorem.functionals), _blocks(proof.unknowns))
    table = {"order": theorem.order, **unknowns_to_json(proof.unknowns, counts)}
    if theorem.lower is not None:
        table["lower"] = [None if d is None else to_text(d) for d in theorem.lower]
    return table


def analysis_from_json(
    system: DelaySystem, gain: Matrix, data: Any, where: str = "variables"
) -> Proof:
    """Read the proof of an analysis; messages of the table name `where`.

    Raises
    ------
    InputError : a missing key, a wrong shape, a number that is none.
    """
    required = ("order", "P", "Q", "R", "eps", "gamma")
    known_keys(data, where, (*required, "lower"), required=required)
    order = _order_from_json(data["order"], f"{where}.order")
    lower = _lower(system, order, data["lower"], f"{where}.lower") if "lower" in data else None
    theorem = AgesTheorem.analysis(system, order, lower)
    shapes = theorem.shapes(system, gain, bounded=_is_bounded(system, data, where))
    counts = _counts_of_analysis(len(theorem.functionals), len(system.blocks))
    return Proof(theorem, unknowns_from_json(data, shapes, counts, where))


def ages_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `ages_from_json` reads."""
    theorem = cast("AgesTheorem", proof.theorem)
    terms = []
    for j, (functional, support) in enumerate(
        zip(theorem.functionals, theorem.supports, strict=True)
    ):
        own = [name for name in UNKNOWNS if f"{name}[{j}]" in proof.unknowns]
        matrices = {name: matrix_to_text(proof.unknowns[f"{name}[{j}]"]) for name in own}
        of = {} if support is None else {support.of: [i + 1 for i in support.numbers]}
        terms.append({"functional": functional, "matrices": matrices} | of)
    beside = unknowns_to_json(proof.unknowns, {"eps": _blocks(proof.unknowns), "gamma": None})
    P = matrix_to_text(proof.unknowns["P"])
    down = theorem.lower is not None
    return {"order": theorem.order, "P": P, "terms": terms, **beside, "down_to_zero": down}


def ages_from_json(system: DelaySystem, gain: Matrix, data: Any, where: str = "variables") -> Proof:
    """Read the proof with ages as they are.

    Raises
    ------
    InputError : a missing key, a wrong shape, a number that is none, or a functional or a support
        that does not hold for a delay.
    """
    keys = ("order", "P", "terms", "eps", "gamma", "down_to_zero")
    known_keys(data, where, keys, required=keys)
    order = _order_from_json(data["order"], f"{where}.order")
    late, tables = positive_delays(system), data["terms"]
    if not isinstance(tables, list) or len(tables) != len(late):
        raise InputError(
            "one per positive delay",
            where=f"{where}.terms",
            expected=f"a list of {len(late)}",
            got=format_value(tables),
        )
    places = [f"{where}.terms[{j}]" for j in range(len(late))]
    for table, place in zip(tables, places, strict=True):
        required = ("functional", "matrices")
        known_keys(table, place, (*required, *_SUPPORTS), required=required)
    if not isinstance(data["down_to_zero"], bool):
        raise InputError(
            "not a truth value",
            where=f"{where}.down_to_zero",
            expected="true or false",
            got=format_value(data["down_to_zero"]),
        )
    functionals = tuple(table["functional"] for table in tables)
    supports = tuple(_support(*each) for each in zip(tables, places, strict=True))
    lower = constants_down_to_zero(functionals) if data["down_to_zero"] and order else None
    theorem = AgesTheorem(order, functionals, supports, lower)
    theorem.check(system, gain)
    shapes = theorem.shapes(system, gain, bounded=_is_bounded(system, data, where))
    beside: Counts = {"P": None, "eps": len(system.blocks), "gamma": None}
    unknowns = unknowns_from_json(data, shapes, beside, where)
    for j, (table, place) in enumerate(zip(tables, places, strict=True)):
        own = {name: s for name in UNKNOWNS if (s := shapes.get(f"{name}[{j}]")) is not None}
        at = f"{place}.matrices"
        known_keys(table["matrices"], at, tuple(own), required=tuple(own))
        matrices = unknowns_from_json(table["matrices"], own, dict.fromkeys(own), at)
        unknowns |= {f"{name}[{j}]": M for name, M in matrices.items()}
    return Proof(theorem, unknowns)


def _is_bounded(system: DelaySystem, data: Any, where: str) -> bool:
    if not system.has_performance:
        check_null(data["gamma"], f"{where}.gamma", expected=True)
    return data["gamma"] is not None


def _order_from_json(order: Any, where: str) -> int:
    if isinstance(order, bool) or not isinstance(order, int) or not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where=where,
            expected=f"an integer from 0 to {MAX_ORDER}",
            got=format_value(order),
        )
    return order


def _lower(system: DelaySystem, order: int, texts: Any, where: str) -> tuple[Any, ...]:
    """The least of each positive delay: from 0 to the delay, null where any age is allowed."""
    late = positive_delays(system)
    fits = order > 0 and isinstance(texts, list) and len(texts) == len(late)
    if not fits or any((x is None) != delay.any_age for x, delay in zip(texts, late, strict=True)):
        raise InputError(
            "does not fit the system",
            where=where,
            expected=f"from order 1 on: {len(late)} numbers, null where any age is allowed",
            got=format_value(texts),
        )
    lower = []
    for j, (text, delay) in enumerate(zip(texts, late, strict=True)):
        low = None if text is None else from_text(text, f"{where}[{j}]")
        if low is not None and not 0 <= low <= exact(delay.d):
            raise InputError(
                "not below the delay",
                where=f"{where}[{j}]",
                expected=f"0 to {delay.d}",
                got=format_value(text),
            )
        lower.append(low)
    return tuple(lower)


def _support(table: dict[str, Any], where: str) -> Support | None:
    """Read the support of a delay; whether it holds is for the theorem to say."""
    given = [key for key in _SUPPORTS if key in table]
    numbers = [table[key] for key in given]
    if len(given) > 1 or not all(
        isinstance(x, list) and all(type(i) is int for i in x) for x in numbers
    ):
        raise InputError(
            "not the support of a delay",
            where=where,
            expected=f"a list of integers, {' or '.join(_SUPPORTS)}",
            got=", ".join(f"{key} {format_value(table[key])}" for key in given),
        )
    if not given:
        return None
    of = cast("Literal['states', 'controls']", given[0])
    return Support(of, tuple(i - 1 for i in numbers[0]))
