"""What a fault is, and the list of all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from falsifier.draft import Draft

Break = Callable[[Draft], None]


@dataclass(frozen=True)
class Fault:
    """One hypothesis broken, alone.

    Attributes
    ----------
    hypothesis, name : the row of the matrix.
    apply : changes a draft; raises `NotHere` in a kind that has nothing to break.
    quick : whether it is in the small share that every run of the tests flies.
    covered : why a claim may stand though it looks broken; it is false only if its rows say so.
    """

    hypothesis: str
    name: str
    apply: Break
    quick: bool = False
    covered: str = ""


FAULTS: list[Fault] = []


def fault(
    hypothesis: str, name: str, *, quick: bool = False, covered: str = ""
) -> Callable[[Break], Break]:
    """Add a function that breaks a draft to the list."""

    def add(apply: Break) -> Break:
        FAULTS.append(Fault(hypothesis, name, apply, quick, covered))
        return apply

    return add
