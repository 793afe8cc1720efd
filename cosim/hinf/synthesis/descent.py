"""Propose gains by a direct descent on the nominal loop, without an LMI.

For a gain with a pattern (`DelaySystem.measured`) the LMIs of a design are not linear in K, and
for a full gain they lose what their multipliers lose. Here K itself is the unknown:

1. from every start, the spectral abscissa is made negative, where it is not;
2. with uncertainty, the gain from p to q, scaled where F has several blocks, is brought below one;
3. where constraints are given that depend on K alone (decay, damping, |K|), what misses them
   most is made negative, the gain from p to q kept below one;
4. the exact norm of the loop, with uncertainty its scaled gain (`loop_gain`), is made small over
   K and the scalings, with a penalty on what misses a constraint.

Each stage is a nonsmooth minimisation (`nonsmooth`) with a fixed number of evaluations: the same
input proposes the same gains. Nothing here is a proof; the analysis of a proposal is.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from cosim.hinf.lmi import units_of
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.synthesis.loop_gain import GainFunction, LoopGain, Value
from cosim.hinf.synthesis.nonsmooth import minimised
from cosim.models import DelaySystem, Matrix

Reals = NDArray[np.float64]

_EVALUATIONS = 150  # of one stage
_RANDOM = 4  # starts beside those given
_SMALL = 1e-5  # weight of |K|^2, in own units: the norm alone may be least at infinity
_STABLE = 0.05  # the abscissa is made less than minus this share of the loop's speed
_SURELY = -0.2  # log of the gain from p to q that is low enough
_PENALTIES = (5.0, 50.0)  # of what misses a constraint, against the logarithm of the norm
_ROOM = 0.01  # by which constraints are met, as shares of them
_NO_CONSTRAINTS = DesignConstraints()
_SCALINGS = np.linspace(-9.0, 9.0, 37)  # log e tried before the descent


def proposals(
    system: DelaySystem,
    starts: Sequence[Matrix] = (),
    *,
    drawn: int = _RANDOM,
    evaluations: int = _EVALUATIONS,
    constraints: DesignConstraints = _NO_CONSTRAINTS,
) -> Iterator[Matrix]:
    """Yield gains (m, n) with the zeros of the system's feedback, one per start that succeeds.

    Parameters
    ----------
    system : Eq. (7); without w and z its gains stabilise only.
    starts : gains to start from, their other columns made zero.
    drawn : further starts: zero, and so many less one that are drawn from a fixed seed.
    evaluations : of each stage, at most.
    constraints : what the nominal loop must meet, but for the peak of the control.
    """
    units = units_of(system)[0]
    descent = Descent(
        LoopGain(system),
        LoopGain(system, only_uncertain=True) if system.E.size else None,
        *(units.input[:, None] / units.state, 1.0 / units.T, evaluations, constraints),
    )
    seeded = np.random.default_rng(2013)
    zero = np.zeros(system.B.T.shape)
    others = (seeded.normal(size=zero.shape) * descent.units if k else zero for k in range(drawn))
    for start in itertools.chain(starts, others):
        K = descent.from_start(start)
        if K is not None:
            yield K


class Descent:
    """The stages, in units of K in which its entries compare.

    Parameters
    ----------
    loop, alone : the loop as a function of its gain; that from p to q, None where F = 0.
    units : (m, n) of the entries of the gain.
    speed : of the loop [1/s].
    evaluations : of each stage, at most.
    constraints : what the nominal loop must meet.
    """

    def __init__(
        self,
        loop: GainFunction,
        alone: GainFunction | None,
        units: Matrix,
        speed: float,
        evaluations: int = _EVALUATIONS,
        constraints: DesignConstraints = _NO_CONSTRAINTS,
    ) -> None:
        self._asked = constraints
        self._is_constrained = any(
            x is not None for x in (constraints.decay, constraints.damping, constraints.gain_limit)
        )
        self._evaluations = evaluations
        self._loop, self._alone, self._speed = loop, alone, speed
        self.units: Matrix = np.where(loop.free, units, 0.0)
        self.least_alone = np.inf
        self.nearest: Matrix | None = None
        """Logarithm of the least gain from p to q that was met, and the gain that has it."""

    def from_start(self, start: Matrix) -> Matrix | None:
        """Return the gain that the stages reach; None where one of them fails."""
        admissible = self._admissible(start)
        if admissible is None or not self._loop.has_gain:
            return None if admissible is None else admissible[0]
        K, log_e = admissible
        if self._loop.has_scaling:
            log_e = log_e - log_e.mean()
            values = [self._loop.gain(K, log_e + e).value for e in _SCALINGS]
            log_e = log_e + _SCALINGS[int(np.argmin(values))]
        if not np.isfinite(self._loop.gain(K, log_e).value):
            return K if self._is_constrained else None
        if not self._is_constrained:
            return self._minimised(self._loop.gain, K, log_e)[0]
        last = K
        for weight in _PENALTIES:
            last, log_e, _ = self._minimised(partial(self._penalised, weight), last, log_e)
            if self._missed(last).value < 0:
                return last
        return K

    def _admissible(self, start: Matrix) -> tuple[Matrix, Reals] | None:
        """Return the gain of the stages before the last, with its scalings.

        Where it misses a constraint it is the nearest: whether it meets them its proof decides.
        """
        K = np.where(self._loop.free, start, 0.0)
        target, log_e = -_STABLE * self._speed, np.zeros(self._loop.scalings)
        if self._loop.abscissa(K).value > target:
            K, _, value = self._minimised(
                lambda K, _: self._loop.abscissa(K), K, log_e, below=target
            )
            if not value < 0:
                return None
        if self._alone is not None:
            alone = self._alone
            if alone.gain(K).value > _SURELY:
                if not np.isfinite(alone.gain(K).value):
                    return None
                balanced = alone.balanced(K)
                if alone.gain(K, balanced).value < alone.gain(K).value:
                    log_e = balanced
                K, log_e, value = self._minimised(alone.gain, K, log_e, below=_SURELY)
                if value < self.least_alone:
                    self.least_alone, self.nearest = value, K
                if not value < 0:
                    return None
        if self._is_constrained:
            K, log_e, _ = self._minimised(self._missed_most, K, log_e, below=-_ROOM)
        return K, log_e

    def _missed(self, K: Matrix) -> Value:
        """Return by which share K misses a constraint, the most of all; negative: it meets them."""
        d, loop = self._asked, self._loop
        shares: list[Value] = []
        if d.damping is not None and d.within is not None:
            shares.append(loop.excess(K, d.damping, d.within))
        if d.decay is not None:
            v = loop.abscissa(K)
            shares.append(v._replace(value=v.value / d.decay + 1, in_gain=v.in_gain / d.decay))
        if d.gain_limit is not None:
            left, sizes, right = np.linalg.svd(K, full_matrices=False)
            slope = np.outer(left[:, 0], right[0]) / d.gain_limit
            shares.append(Value(sizes[0] / d.gain_limit - 1, slope, np.zeros(loop.scalings)))
        return max(shares, key=lambda x: x.value)

    def _missed_most(self, K: Matrix, log_e: Reals) -> Value:
        """Return `_missed`, or the gain from p to q where that is higher."""
        missed = self._missed(K)
        if self._alone is None:
            return missed
        alone = self._alone.gain(K, log_e)
        alone = alone._replace(value=alone.value - _SURELY / 2)
        return max(missed, alone, key=lambda x: x.value)

    def _penalised(self, weight: float, K: Matrix, log_e: Reals) -> Value:
        """Return the gain, with a penalty on what misses a constraint."""
        gain, missed = self._loop.gain(K, log_e), self._missed(K)
        more = missed.value + _ROOM
        if not more > 0:
            return gain
        return gain._replace(
            value=gain.value + weight * more, in_gain=gain.in_gain + weight * missed.in_gain
        )

    def _minimised(
        self,
        function: Callable[[Matrix, Reals], Value],
        K: Matrix,
        log_e: Reals,
        below: float = -np.inf,
    ) -> tuple[Matrix, Reals, float]:
        """Minimise over the free entries of K and, where they are used, log e."""
        free = self.units != 0
        count = int(free.sum())

        def gain_of(x: Reals) -> Matrix:
            gain = np.zeros(K.shape)
            gain[free] = x[:count] * self.units[free]
            return gain

        def of(x: Reals) -> tuple[float, Reals]:
            value = function(gain_of(x), x[count:])
            slope = np.append((value.in_gain * self.units)[free], value.in_scaling)
            slope[:count] += 2 * _SMALL * x[:count]
            return value.value + _SMALL * float(x[:count] @ x[:count]), slope

        start = np.append(K[free] / self.units[free], log_e)
        best = minimised(of, start, evaluations=self._evaluations, below=below)
        return gain_of(best.x), best.x[count:], best.value
