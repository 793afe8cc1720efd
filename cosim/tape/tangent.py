"""Record directional derivatives of recorded values (forward mode)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from cosim.tape.record import Scalar, Tape, required_places


def tangents(
    tape: Tape, roots: Sequence[Scalar], seeds: Mapping[int, Scalar]
) -> list[Scalar | None]:
    """Return the derivative of each root in the direction `seeds` (place of a symbol -> change).

    None stands for a derivative that is always zero.

    Raises
    ------
    NotImplementedError : an operation that has no rule yet.
    """
    moved: dict[int, Scalar | None] = {}
    for place in required_places(tape, [root.place for root in roots]):
        one = tape.operations[place]
        changes = [moved[p] for p in one.operands]
        if all(change is None for change in changes):
            moved[place] = seeds.get(place)
        else:
            values = [Scalar(tape, p) for p in one.operands]
            moved[place] = _rule(one.name, values, changes)
    return [moved[root.place] for root in roots]


def _rule(operation: str, values: list[Scalar], changes: list[Scalar | None]) -> Scalar | None:
    if operation == "negate":
        return None if changes[0] is None else -changes[0]
    if operation in ("+", "-"):
        a, b = changes
        if b is None:
            return a
        signed = b if operation == "+" else -b
        return signed if a is None else a + signed
    if operation == "*":
        products = [
            change * other
            for change, other in zip(changes, reversed(values), strict=True)
            if change is not None
        ]
        return products[0] if len(products) == 1 else products[0] + products[1]
    raise NotImplementedError(f"the derivative of {operation} is not recorded")
