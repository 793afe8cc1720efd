"""What is chosen of each delay for `cosim.hinf.theorems.ages`: the theorem with its parameters.

Each positive delay has one of six functionals:

    constant    the delay is constant, exactly d
    jensen      any age from 0 to d, however it varies, at order 0
    interval    any age from least_age to d, however it varies
    rate        the same, with |age'| <= rate
    wirtinger   sampled: the age is least_age, then grows at rate one to d at most
    looped      the same; sharper, with more unknowns

An age with a known rate is one of any variation as well, and so is a sampled one. An analysis takes
each age to be constant or any one ("constant", "jensen"); at order 0 it is Theorem 1, where the
terms of each delay grow with it, so that what holds at d holds below it. From order 1 on the
functional belongs to its delay, and the claim is about exactly that one; or about every constant
delay of a box: there -Phi > 0 is shown at every corner, with the same P, Q, R. In between it
follows, since y is affine in the delays and f and v are without them, so that Phi is affine in them
but for dj^2 f'Rj f, convex by Rj > 0. P + diag(..) > 0 at the upper ends holds below them, by
Qj > 0. (At dj = 0, xj = x, W_j0 = x and the other W_jk = 0: the same sums, with V = x'P x.)

The terms of a delay are about y(t) = C x(t): the whole state, or its `Support`. Its rows and
unknowns then have the size of y instead of n.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.exact import exact
from cosim.hinf.theorems.ages import Age, age_inequalities, shapes_of_ages, widest_functional
from cosim.hinf.theorems.inequality import Inequality, Shape
from cosim.hinf.theorems.loop import Loop, Support, positive_delays
from cosim.hinf.theorems.proof import Theorem, require_size

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

MAX_BOX = 4
"""Most delays of an analysis that covers smaller ones: it has two corners for each, multiplied."""

MAX_CORNERS = 64
"""Most corners at which -Phi is shown: two or four for each delay whose age varies."""

MAX_ORDER = 12
"""Highest order; beyond order 3 gamma changes in the fifth digit."""


@dataclass(frozen=True, eq=False)
class AgesTheorem(Theorem):
    """The inequalities of `ages` with what is chosen of every positive delay.

    The unknowns are P, those of each delay such as Q[j], eps[b] and gamma.

    order : N.
    functionals : one that holds for it, per positive delay (`functionals_of`).
    supports : what its terms are about; None: the whole state.
    lower : the least constant length [s] that is covered, a `fmpq` per positive delay; None for
        one whose age varies, and as a whole where exactly the delays themselves are covered.
    is_analysis : each age is taken to be constant or any one ("constant", "jensen").
    """

    order: int
    functionals: tuple[str, ...]
    supports: tuple[Support | None, ...]
    lower: tuple[Any, ...] | None = None
    is_analysis: bool = False

    @classmethod
    def analysis(cls, system: DelaySystem, order: int, lower: Any = None) -> AgesTheorem:
        """Return the theorem that takes each age to be constant or any one."""
        functionals = tuple(map(widest_functional, positive_delays(system)))
        return cls(order, functionals, (None,) * len(functionals), lower, is_analysis=True)

    def ages(self, loop: Loop) -> list[Age]:
        """Return the terms of every positive delay."""
        lower = self.lower or (None,) * len(self.functionals)
        return [
            Age(loop, j, functional, self.order, low)
            for j, (functional, low) in enumerate(zip(self.functionals, lower, strict=True))
        ]

    def inequalities(
        self, system: DelaySystem, gain: Matrix, *, bounded: bool
    ) -> Iterator[Inequality]:
        """Yield what must be positive, -Phi at every corner last."""
        loop = Loop.of(system, gain, self.supports)
        yield from age_inequalities(loop, self.ages(loop), bounded=bounded)

    def shapes(self, system: DelaySystem, gain: Matrix, *, bounded: bool) -> dict[str, Shape]:
        """Return the shape of every unknown."""
        loop = Loop.of(system, gain, self.supports)
        ages = self.ages(loop)
        rows = len(system.A) + system.C.shape[1] + system.E.shape[1]
        rows += sum(age.width * len(age.names) for age in ages)
        looped = [age for age in ages if age.functional == "looped"]
        require_size(rows + sum(age.width * (1 + age.late) for age in looped))
        require_size(prod(len(age.corners()) for age in ages), MAX_CORNERS, "corners")
        shapes = shapes_of_ages(loop, ages, bounded=bounded)
        return {name: shape for name, shape in shapes.items() if name != "1/gamma"}

    def obstacle(
        self, system: DelaySystem, gain: Matrix, unknowns: Mapping[str, Any]
    ) -> str | None:
        """Return whether gamma is not positive; None if nothing is wrong."""
        self.check(system, gain)
        gamma = unknowns.get("gamma")
        return "gamma is not positive" if gamma is not None and not gamma > 0 else None

    def check(self, system: DelaySystem, gain: Matrix) -> None:
        """Refuse functionals, supports or lower delays that do not fit.

        Raises
        ------
        InputError : naming the delay.
        """
        self._check_functionals(system)
        _check_supports(system, gain, self.supports)
        if self.is_analysis and sum(low is not None for low in self.lower or ()) > MAX_BOX:
            raise InputError(
                "too many delays to be covered at once",
                where="variables.lower",
                expected=f"at most {MAX_BOX} numbers",
                got=str(len(self.lower or ())),
            )

    def _check_functionals(self, system: DelaySystem) -> None:
        positive = positive_delays(system)
        if len(self.functionals) != len(positive):
            raise InputError(
                "one functional per positive delay",
                where="functionals",
                expected=str(len(positive)),
                got=str(len(self.functionals)),
            )
        for j, (functional, delay) in enumerate(zip(self.functionals, positive, strict=True)):
            possible = functionals_of(delay, is_analysis=self.is_analysis)
            if functional not in possible:
                raise InputError(
                    "this functional does not hold for the delay",
                    where=f"variables.terms[{j}].functional",
                    expected=" or ".join(possible),
                    got=str(functional),
                )


def constants_down_to_zero(functionals: Sequence[str]) -> tuple[Any, ...]:
    """Return the `lower` of a claim that covers every constant delay, from order 1 on."""
    zero = exact(0.0)
    return tuple(zero if functional == "constant" else None for functional in functionals)


def functionals_of(delay: Delay, *, is_analysis: bool = False) -> tuple[str, ...]:
    """Return the functionals that hold for a positive delay, the sharpest first."""
    if is_analysis:
        return (widest_functional(delay),)
    if delay.sampled:
        return ("looped", "wirtinger", "interval")
    if delay.rate is not None:
        return ("rate", "interval")
    return ("interval",) if delay.any_age else ("constant",)


def supports_of(
    system: DelaySystem, gain: Matrix, *, controls: bool = False
) -> tuple[Support | None, ...]:
    """Return the least states that every positive delay needs late; None where it needs all.

    controls : the controls instead, where a delay acts through fewer of them than states.
    """
    supports: list[Support | None] = []
    for delay, acting in _acting_late(system, gain):
        states = np.flatnonzero(np.vstack([delay.A, delay.H, acting]).any(axis=0))
        rows = np.flatnonzero(acting.any(axis=1))
        support = Support("states", tuple(map(int, states)) or (0,))
        if controls and 0 < rows.size < states.size and not (delay.A.any() or delay.H.any()):
            support = Support("controls", tuple(map(int, rows)))
        supports.append(
            None if support.of == "states" and len(support.numbers) == len(system.A) else support
        )
    return tuple(supports)


def _acting_late(system: DelaySystem, gain: Matrix) -> list[tuple[Delay, Matrix]]:
    """Return every positive delay with K S_i, without the rows of a control that does nothing."""
    live = np.vstack([system.B, system.D2]).any(axis=0, keepdims=True).T
    pairs = zip(system.delays, system.selections[1:], strict=True)
    return [(delay, live * gain * selection) for delay, selection in pairs if delay.d > 0]


def _check_supports(system: DelaySystem, gain: Matrix, supports: Sequence[Support | None]) -> None:
    """Refuse a support outside of which a delay acts; an `InputError` that names the delay."""
    through_delays = _acting_late(system, gain)
    for j, ((delay, acting), support) in enumerate(zip(through_delays, supports, strict=True)):
        if support is None:
            continue
        size, what = (len(system.A), "state") if support.of == "states" else (len(gain), "control")
        where = f"variables.terms[{j}].{support.of}"
        got = str([i + 1 for i in support.numbers])
        fits = support.numbers and all(0 <= i < size for i in support.numbers)
        if not fits or list(support.numbers) != sorted(set(support.numbers)):
            raise InputError(
                f"not an ascending list of {what}s",
                where=where,
                expected=f"numbers from 1 to {size}",
                got=got,
            )
        if support.of == "states":
            outside = np.delete(np.vstack([delay.A, delay.H, acting]), support.numbers, axis=1)
        else:
            outside = np.vstack([delay.A, delay.H, np.delete(acting, support.numbers, axis=0)])
        if outside.any():
            raise InputError(
                "the delay acts outside its support",
                where=where,
                expected=f"every {what} that acts through the delay",
                got=got,
            )
