"""What is chosen of each delay for `cosim.hinf.theorems.ages`, and the unknowns of a proof.

Each positive delay has one of five functionals:

    constant    the delay is constant, exactly d
    interval    any age from least_age to d, however it varies
    rate        the same, with |age'| <= rate
    wirtinger   sampled: the age is least_age, then grows at rate one to d at most
    looped      the same; sharper, with more unknowns

An age with a known rate is one of any variation as well, and so is a sampled one.
docs/explanation/theory.md derives the equations.

The terms of a delay are about y(t) = C x(t): the whole state, or its `Support`. Its rows and
unknowns then have the size of y instead of n.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from cosim.core import InputError
from cosim.hinf.theorems import NOT_SYMMETRIC, Support, Supports, eps_by_name, gamma_by_name

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

AgeFunctional = Literal["constant", "interval", "rate", "wirtinger", "looped"]
FUNCTIONALS: tuple[str, ...] = get_args(AgeFunctional)


@dataclass(frozen=True)
class AgeTerms:
    """The part of one positive delay: its functional, and its matrices by name.

    The names are those of the inequalities without the delay's number; the matrices are arrays of
    floats from a solver, `fmpq_mat` in a proof. `support`: what they are about; None: the whole
    state.
    """

    functional: AgeFunctional
    matrices: dict[str, Any]
    support: Support | None = None


@dataclass(frozen=True)
class AgesVariables:
    """The variables: P, the terms of every positive delay, eps and gamma.

    `eps` is one number, or a tuple of one per block of F; None without uncertainty. `gamma` is
    None for stability alone. `down_to_zero` : the claim covers every constant delay up to its
    bound, not exactly the bound (order 0 always does).
    """

    order: int
    P: Any
    terms: tuple[AgeTerms, ...]
    eps: Any
    gamma: Any
    down_to_zero: bool = False

    @property
    def functionals(self) -> tuple[AgeFunctional, ...]:
        """The functional of every positive delay."""
        return tuple(own.functional for own in self.terms)

    @property
    def supports(self) -> tuple[Support | None, ...]:
        """The support of every positive delay; None: the whole state."""
        return tuple(own.support for own in self.terms)

    def by_name(self) -> dict[str, Any]:
        """Return the unknowns of the inequalities by name."""
        found = {"P": self.P} | gamma_by_name(self.gamma)
        for j, own in enumerate(self.terms):
            found |= {f"{name}[{j}]": M for name, M in own.matrices.items()}
        return found | eps_by_name(self.eps)

    def symmetric_matrices(self) -> list[tuple[str, Any]]:
        """Return every matrix that must be symmetric, with its name."""
        found = [("P", self.P)]
        for j, own in enumerate(self.terms):
            found += [(f"{k}[{j}]", M) for k, M in own.matrices.items() if is_symmetric_unknown(k)]
        return found


def late_delays(system: DelaySystem) -> list[Delay]:
    """Return the positive delays; one of zero is none, its term belongs to x(t)."""
    return [delay for delay in system.delays if delay.d > 0]


def choices(delay: Delay) -> tuple[AgeFunctional, ...]:
    """Return the functionals that hold for a positive delay, the sharpest first."""
    if delay.sampled:
        return ("looped", "wirtinger", "interval")
    if delay.rate is not None:
        return ("rate", "interval")
    return ("interval",) if delay.any_age else ("constant",)


def check_functionals(system: DelaySystem, functionals: tuple[str, ...]) -> None:
    """Refuse what does not hold for a delay.

    Raises
    ------
    InputError : naming the delay.
    """
    late = late_delays(system)
    if len(functionals) != len(late):
        raise InputError(
            "one functional per positive delay",
            where="functionals",
            expected=str(len(late)),
            got=str(len(functionals)),
        )
    for j, (own, delay) in enumerate(zip(functionals, late, strict=True)):
        if own not in choices(delay):
            raise InputError(
                "this functional does not hold for the delay",
                where=f"variables.terms[{j}].functional",
                expected=" or ".join(choices(delay)),
                got=str(own),
            )


def supports_of(
    system: DelaySystem, gain: Matrix, *, controls: bool = False
) -> tuple[Support | None, ...]:
    """Return the least states that every positive delay needs late; None where it needs all.

    controls : the controls instead, where a delay acts through fewer of them than states.
    """
    found: list[Support | None] = []
    for delay, acting in _acting_late(system, gain):
        states = np.flatnonzero(np.vstack([delay.A, delay.H, acting]).any(axis=0))
        rows = np.flatnonzero(acting.any(axis=1))
        own = Support("states", tuple(map(int, states)) or (0,))
        if controls and 0 < rows.size < states.size and not (delay.A.any() or delay.H.any()):
            own = Support("controls", tuple(map(int, rows)))
        found.append(None if own.of == "states" and len(own.numbers) == len(system.A) else own)
    return tuple(found)


def _acting_late(system: DelaySystem, gain: Matrix) -> list[tuple[Delay, Matrix]]:
    """Return every positive delay with K S_i, without the rows of a control that does nothing."""
    live = np.vstack([system.B, system.D2]).any(axis=0, keepdims=True).T
    pairs = zip(system.delays, system.selections[1:], strict=True)
    return [(delay, live * gain * selection) for delay, selection in pairs if delay.d > 0]


def check_supports(system: DelaySystem, gain: Matrix, supports: Supports) -> None:
    """Refuse a support outside of which a delay acts.

    Raises
    ------
    InputError : naming the delay.
    """
    late = _acting_late(system, gain)
    for j, ((delay, acting), own) in enumerate(zip(late, supports, strict=True)):
        if own is None:
            continue
        size, what = (len(system.A), "state") if own.of == "states" else (len(gain), "control")
        where = f"variables.terms[{j}].{own.of}"
        got = str([i + 1 for i in own.numbers])
        fits = own.numbers and all(0 <= i < size for i in own.numbers)
        if not fits or list(own.numbers) != sorted(set(own.numbers)):
            raise InputError(
                f"not an ascending list of {what}s",
                where=where,
                expected=f"numbers from 1 to {size}",
                got=got,
            )
        if own.of == "states":
            outside = np.delete(np.vstack([delay.A, delay.H, acting]), own.numbers, axis=1)
        else:
            outside = np.vstack([delay.A, delay.H, np.delete(acting, own.numbers, axis=0)])
        if outside.any():
            raise InputError(
                "the delay acts outside its support",
                where=where,
                expected=f"every {what} that acts through the delay",
                got=got,
            )


def is_symmetric_unknown(name: str) -> bool:
    """Whether the unknown of that name is a symmetric matrix."""
    return name not in NOT_SYMMETRIC
