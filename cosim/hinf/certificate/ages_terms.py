"""What the functional of `ages_proof` consists of: its unknowns and the rows of its inequality.

Each positive delay has one of five functionals:

    constant    the delay is constant, exactly d
    interval    any age from least_age to d, however it varies
    rate        the same, with |age'| <= rate
    wirtinger   sampled: the age is least_age, then grows at rate one to d at most
    looped      the same; sharper, with more unknowns

An age with a known rate is one of any variation as well, and so is a sampled one. The unknowns
and the equations are those of `ages_proof`; docs/explanation/theory.md derives them.

The terms of a delay are about y(t) = C x(t): the whole state, or its `Support`. Its rows and
unknowns then have the size of y instead of n.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from cosim.core import InputError

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

AgeFunctional = Literal["constant", "interval", "rate", "wirtinger", "looped"]
FUNCTIONALS: tuple[str, ...] = get_args(AgeFunctional)


@dataclass(frozen=True)
class Support:
    """What of x is needed late, y(t - age) with y = C x: the support of one delay.

    Attributes
    ----------
    of : "states": C selects states, the others have no entry in A_i + B K S_i, H_i and D2 K S_i.
        "controls": C is rows of K S_i, where A_i = 0 and H_i = 0, and the delay acts through u.
    numbers : of the states or controls, from 0, ascending.
    """

    of: Literal["states", "controls"]
    numbers: tuple[int, ...]


Supports = Sequence[Support | None]
"""The support of every positive delay; None: the whole state."""


@dataclass(frozen=True)
class AgeTerms:
    """The part of one positive delay: its functional, and its matrices by name.

    The names and shapes are those of `unknowns_of`; the matrices are arrays of floats from a
    solver, `fmpq_mat` in a proof. `support`: what they are about; None: the whole state.
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


def widths_of(system: DelaySystem, supports: Supports | None) -> list[int]:
    """Return the size of y of every positive delay."""
    n, late = len(system.A), late_delays(system)
    each = [None] * len(late) if supports is None else supports
    return [n if own is None else len(own.numbers) for own in each]


def rows_of(
    system: DelaySystem,
    order: int,
    functionals: tuple[AgeFunctional, ...],
    *,
    gamma: bool,
    supports: Supports | None = None,
) -> dict[str, int]:
    """Return the rows of -Phi by name, in order, without those that one corner adds.

    x(t) is "x", y(t - tau_j) is "x{j}"; "h{j}" and "d{j}" are y(t - least_age), y(t - d);
    "W{j},{k}" the means over the constant part, "a{j}" and "b{j}" those over
    [t - tau, t - least_age] and [t - d, t - tau]; "t{j}" is y(s_k + least_age) and "r{j}"
    y'(t - least_age). `gamma`: with a row for w.
    """
    sizes = {"x": len(system.A)}
    widths = widths_of(system, supports)
    each = zip(functionals, late_delays(system), widths, strict=True)
    for j, (own, delay, width) in enumerate(each):
        means = [f"W{j},{k}" for k in range(order)]
        if own == "constant":
            sizes |= dict.fromkeys([f"x{j}", *means], width)
            continue
        names = [f"h{j}", *means] if delay.least_age > 0 else []
        names.append(f"x{j}")
        if own in {"interval", "rate"}:
            names += [f"d{j}", *((f"a{j}", f"b{j}") if order else ())]
        if own == "looped" and delay.least_age > 0:
            names += [f"t{j}", f"r{j}"]
        sizes |= dict.fromkeys(names, width)
    if gamma:
        sizes["w"] = system.C.shape[1]
    if system.E.size:
        sizes["p"] = system.E.shape[1]
    return sizes


def state_blocks(
    system: DelaySystem,
    order: int,
    functionals: tuple[AgeFunctional, ...],
    supports: Supports | None = None,
) -> dict[str, int]:
    """Return the blocks of the vector of V: "x", then the name and index of each further one.

    With the size of each.
    """
    blocks = {"x": len(system.A)}
    widths = widths_of(system, supports)
    each = zip(functionals, late_delays(system), widths, strict=True)
    for j, (own, delay, width) in enumerate(each):
        names = []
        if own == "constant" or delay.least_age > 0:
            names += [f"W{j},{k}" for k in range(order)]
        if own == "looped" and delay.least_age > 0:
            names.append(f"h{j}")
        if own == "interval" and order:
            names.append(f"ab{j}")
        if own == "rate" and order:
            names += [f"a{j}", f"b{j}"]
        blocks |= dict.fromkeys(names, width)
    return blocks


def unknowns_of(
    system: DelaySystem,
    order: int,
    functionals: tuple[AgeFunctional, ...],
    *,
    gamma: bool,
    supports: Supports | None = None,
) -> list[dict[str, tuple[int, int]]]:
    """Return the name and shape of the matrices of every positive delay.

    All are symmetric but M, X_b and Y (`is_symmetric_unknown`).
    """
    rows = sum(rows_of(system, order, functionals, gamma=gamma, supports=supports).values())
    found = []
    widths = widths_of(system, supports)
    for own, delay, n in zip(functionals, late_delays(system), widths, strict=True):
        names: dict[str, tuple[int, int]] = {}
        first = own == "constant" or delay.least_age > 0
        if first:
            names |= {"Q": (n, n), "R": (n, n)}
        if own in {"interval", "rate"}:
            m = 2 * n if order else n
            names |= {"S": (n, n)} if own == "interval" else {"S_1": (n, n), "S_2": (n, n)}
            names |= {"Z": (n, n), "M": (m, m)}
        if own == "wirtinger":
            names["W"] = (n, n)
        if own == "looped":
            m = 2 * n if first else n
            names |= {"N": (n, n)} if first else {}
            names |= {"U": (m, m), "X_a": (m, m), "X_b": (m, m), "Y": (rows, m)}
        found.append(names)
    return found


def is_symmetric_unknown(name: str) -> bool:
    """Whether the unknown of that name is a symmetric matrix."""
    return name not in {"M", "X_b", "Y"}
