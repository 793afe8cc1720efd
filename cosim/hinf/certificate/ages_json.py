"""A proof with given ages as JSON.

Of an analysis: Q, R one matrix per positive delay, Q null where any age is allowed; "lower", where
it is given, is the least of each positive delay that the claim covers, null where any age is:

    {"order": 0, "P": [["p/q", ...]], "Q": [...], "R": [...], "eps": ..., "gamma": ...}

Of ages as they are, one of "terms" per positive delay; beside its matrices "states" or "controls",
numbers from 1, is its support; without it the terms are about the whole state:

    {"order": 1, "P": [["p/q", ...]], "eps": ..., "gamma": ..., "down_to_zero": false,
     "terms": [{"functional": "looped", "matrices": {"U": ..., "X_a": ...}}]}

gamma is null where stability alone is proved.
"""

from __future__ import annotations

from typing import Any, Literal, cast

from cosim.core import InputError, format_value
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.unknowns_json import (
    Counts,
    blocks_in,
    check_null,
    counts_of,
    list_of,
    unknowns_from_json,
    unknowns_to_json,
)
from cosim.hinf.exact import exact, from_text, matrix_to_text, to_text
from cosim.hinf.theorems import (
    MAX_ORDER,
    UNKNOWNS,
    AgesTheorem,
    Proof,
    Support,
    constants_down_to_zero,
    positive_delays,
)
from cosim.models import DelaySystem, Matrix

_SUPPORTS = ("states", "controls")


def analysis_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `analysis_from_json` reads."""
    theorem = cast("AgesTheorem", proof.theorem)
    counts = counts_of("P", len(theorem.functionals), blocks_in(proof.unknowns))
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
    counts = counts_of("P", len(theorem.functionals), len(system.blocks))
    return Proof(theorem, unknowns_from_json(data, shapes, counts, where))


def ages_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `ages_from_json` reads."""
    theorem = cast("AgesTheorem", proof.theorem)
    terms = []
    for j, (functional, support) in enumerate(
        zip(theorem.functionals, theorem.supports, strict=True)
    ):
        names = [name for name in UNKNOWNS if f"{name}[{j}]" in proof.unknowns]
        matrices = {name: matrix_to_text(proof.unknowns[f"{name}[{j}]"]) for name in names}
        of = {} if support is None else {support.of: [i + 1 for i in support.numbers]}
        terms.append({"functional": functional, "matrices": matrices} | of)
    beside = unknowns_to_json(proof.unknowns, {"eps": blocks_in(proof.unknowns), "gamma": None})
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
    count = len(positive_delays(system))
    tables = list_of(data["terms"], count, f"{where}.terms", "one per positive delay")
    places = [f"{where}.terms[{j}]" for j in range(count)]
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
        shapes_of_term = {
            name: s for name in UNKNOWNS if (s := shapes.get(f"{name}[{j}]")) is not None
        }
        at = f"{place}.matrices"
        known_keys(table["matrices"], at, tuple(shapes_of_term), required=tuple(shapes_of_term))
        matrices = unknowns_from_json(
            table["matrices"], shapes_of_term, dict.fromkeys(shapes_of_term), at
        )
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
    positive = positive_delays(system)
    fits = order > 0 and isinstance(texts, list) and len(texts) == len(positive)
    if not fits or any(
        (x is None) != delay.any_age for x, delay in zip(texts, positive, strict=True)
    ):
        raise InputError(
            "does not fit the system",
            where=where,
            expected=f"from order 1 on: {len(positive)} numbers, null where any age is allowed",
            got=format_value(texts),
        )
    lower = []
    for j, (text, delay) in enumerate(zip(texts, positive, strict=True)):
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
