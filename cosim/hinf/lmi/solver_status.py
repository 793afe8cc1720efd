"""The status with which the solver ends, and why it found no point.

A status is no proof. Clarabel may fail before it finds or excludes a solution, and it excludes
one to a tolerance only. So an error says that there is no solution only where that is proved
(`cosim.hinf.lmi.refutation`); otherwise that none was found, with the reason of `not_found`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Literal

Status = Literal["solved", "inaccurate", "infeasible", "unbounded", "failed"]

_STATUS: dict[str, Status] = {
    "Solved": "solved",
    "AlmostSolved": "inaccurate",
    "InsufficientProgress": "inaccurate",
    "MaxIterations": "inaccurate",
    "PrimalInfeasible": "infeasible",
    "AlmostPrimalInfeasible": "infeasible",
    "DualInfeasible": "unbounded",
    "AlmostDualInfeasible": "unbounded",
}

OTHER_UNITS = "other units for states, inputs and time, so that their numbers are near 1"
OTHER_ROUTES = f"another condition (order 1), a gamma to meet, or {OTHER_UNITS}"
"""What to try if the solver failed."""

FAILED = "the solver failed"

_counters: ContextVar[tuple[Counter[str], ...]] = ContextVar("counters", default=())


def status_of(word: str) -> Status:
    """Return what a status of the solver means; an unknown one is a failure."""
    return _STATUS.get(word, "failed")


@contextmanager
def solver_words() -> Iterator[Counter[str]]:
    """Count the statuses of all solves in this context."""
    counter: Counter[str] = Counter()
    token = _counters.set((*_counters.get(), counter))
    try:
        yield counter
    finally:
        _counters.reset(token)


def count(word: str) -> None:
    """Count a solve that ended with this status."""
    for counter in _counters.get():
        counter[word] += 1


def not_found(words: Mapping[str, int]) -> str:
    """Return why no point was found, by how many solves ended with each status.

    A failure is reported first: that solve might have found a point.
    """
    total = sum(words.values())
    lost = {word: n for word, n in words.items() if status_of(word) in {"failed", "inaccurate"}}
    if lost:
        counts = (f"{word} in {n} of {total} problems" for word, n in sorted(lost.items()))
        listed = ", ".join(lost) if total == 1 else ", ".join(counts)
        return f"{FAILED} (status {listed}) before it found or excluded a solution"
    if any(status_of(word) == "infeasible" for word in words):
        return "the solver finds multipliers against any solution, which is not proved exactly"
    if any(status_of(word) == "unbounded" for word in words):
        return "the solver finds no bound, and no solution with one"
    return "the solver finds no feasible point, which does not prove that there is none"
