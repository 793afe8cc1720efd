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

from collections.abc import Iterator
from typing import Any

import numpy as np

from cosim.core import Findings, InputError, Values, valid
from cosim.hinf.certificate.system_parts import BLOCKS, MATRICES, SystemPart, matrix_from_rows
from cosim.models import DelaySystem, Feedback, Matrix


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
    return [row if isinstance(row, bool) else list(row) for row in feedback]


class _SystemOfCertificate(SystemPart):
    """A system as `system_to_json` writes it."""

    integrals: int = 0
    """How many of the states, the last ones, the controller keeps as integrals."""


def system_from_json(data: Any, where: str = "system") -> DelaySystem:
    """Read the system that `system_to_json` wrote.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    findings = Findings(Values(name=where))
    part = valid(_SystemOfCertificate, data, findings.origin)
    terms = part.terms(findings)
    with findings.at():
        return part.system(terms, integrals=part.integrals)


def gain_from_json(rows: Any, system: DelaySystem) -> Matrix:
    """Read K (m, n) of a certificate; [] where there is no control.

    Raises
    ------
    InputError : not a matrix, or of another shape.
    """
    n, m = system.B.shape
    if rows == [] and m == 0:
        return np.zeros((0, n))
    gain = matrix_from_rows(rows, "K")
    if gain.shape != (m, n):
        raise InputError("wrong shape", where="K", expected=str((m, n)), got=str(gain.shape))
    check_measured(gain, system)
    return gain


def check_measured(gain: Matrix, system: DelaySystem) -> None:
    """Refuse a gain (m, n) that acts on a state that is not measured, or not by this control.

    Raises
    ------
    InputError : naming the first such entry.
    """
    acting = np.argwhere((gain != 0) & ~system.free)
    if acting.size:
        i, j = acting[0]
        raise InputError(
            "the gain acts on a state that is not measured",
            where=f"K[{i + 1},{j + 1}]",
            expected="0, since no feedback contains this state",
            got=repr(float(gain[i, j])),
            hint="add the state to feedback of the system or of a delay, or make its column zero",
        )


def known_keys(
    data: Any, where: str, known: tuple[str, ...], *, required: tuple[str, ...] = ()
) -> None:
    """Refuse anything but a table, an unknown key (naming the nearest known), a missing key."""
    if not isinstance(data, dict):
        raise InputError(
            "not a table of keys", where=where, expected="keys", got=type(data).__name__
        )
    for key in data:
        if key not in known:
            raise InputError.unknown("key", str(key), known, where=where)
    for key in required:
        if key not in data:
            raise InputError(
                f"{key!r} is missing",
                where=where,
                expected=", ".join(required),
                got=", ".join(map(str, data)) or "nothing",
            )


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
