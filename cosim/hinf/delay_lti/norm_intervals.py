"""Find the intervals that prove a bound of the norm: `cosim.hinf.certificate.norm_proof`."""

from __future__ import annotations

import math
from typing import Any

import flint
import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.certificate import MAX_STEPS, NORM_BITS, NormPoint, NormProof, bend, norm_to_json
from cosim.hinf.delay_lti.blocks import Blocks
from cosim.hinf.delay_lti.closed_loop import checked_matrix
from cosim.hinf.delay_lti.norm import NormResult
from cosim.hinf.delay_lti.retarded import plain_of
from cosim.hinf.exact import ball_precision
from cosim.models import DelaySystem

_ABOVE = (1e-8, 1e-6, 1e-4, 1e-2)  # relative distances of the bounds tried
_AT_ONCE = (3, 10)  # of the lengths of a step, the first ones and then some more: most are enough
_FARTHEST = 1e9  # W, against the sum of the rates


def norm_proved(system: DelaySystem, K: ArrayLike, level: float) -> bool:
    """Prove that the loop is stable and |G(jw)| < level for every real w.

    Parameters
    ----------
    system : Eq. (7), with w and z; its E, H are ignored. All delays are constants.
    K : (m, n) state feedback, its doubles taken exactly.
    level : the bound.

    Returns
    -------
    True if it is proved. False decides nothing: the bound may be wrong, the loop unstable, or
    too many intervals necessary.

    Raises
    ------
    InputError : no w or no z, K that does not fit, or a level that is no positive number.
    """
    gain = _checked(system, K, level)
    with ball_precision(NORM_BITS):
        return _Search(system, gain, level).steps() is not None


def norm_certificate(system: DelaySystem, K: ArrayLike, level: float) -> dict[str, Any] | None:
    """Return the proof of `norm_proved` as JSON, for `check_certificate`; None without one.

    Raises
    ------
    InputError : as `norm_proved`.
    """
    gain = _checked(system, K, level)
    with ball_precision(NORM_BITS):
        steps = _Search(system, gain, level).steps()
    return None if steps is None else norm_to_json(system, gain, level, *steps)


def norm_proved_of(blocks: Blocks, norm: NormResult) -> float | None:
    """Return a number near the norm that it is proved to lie below; None without a proof.

    The proof is in ball arithmetic and shows stability as well. None also for systems that no
    `DelaySystem` has the norm of.
    """
    if blocks.is_neutral or not blocks.order or not norm.value > 0.0:
        return None
    plain = plain_of(blocks)
    system = None if plain is None else plain.system()
    if system is None:
        return None
    K = np.zeros((0, blocks.order))
    levels = (norm.value * (1.0 + share) for share in _ABOVE)
    return next((level for level in levels if norm_proved(system, K, level)), None)


def _checked(system: DelaySystem, K: ArrayLike, level: float) -> Any:
    """Return K (m, n); refuse what cannot be a proof."""
    n, m = system.B.shape
    gain = checked_matrix("K", K, m, n)
    if not system.has_performance:
        raise InputError("this system has no gain to bound", where="system", expected="C and D")
    if not (math.isfinite(level) and level > 0.0):
        raise InputError("not a level", where="level", expected="a number > 0", got=repr(level))
    return gain


class _Search(NormProof):
    """One attempt: steps as long as part A allows."""

    def steps(self) -> tuple[list[tuple[float, float]], float] | None:
        """Return the intervals and W of a proof; None without one."""
        try:
            end = self._end()
            return None if end is None else self._swept(end)
        except ZeroDivisionError:  # H is singular at a centre, or as good as
            return None

    def _end(self) -> float | None:
        """Return W: the least of a few frequencies for part B and the phase on the arc; or None."""
        a = float(self.a.upper())
        w = 1.25 * a
        while 0.0 < w < _FARTHEST * a:
            if self.ends_at(w):
                return w
            w *= 1.25
        return None

    def _swept(self, end: float) -> tuple[list[tuple[float, float]], float] | None:
        """Parts A and C over [0, end]."""
        steps: list[tuple[float, float]] = []
        point, done, turned = self.point(0.0), 0.0, flint.arb(0)
        last, h = point, 0.0
        for _ in range(MAX_STEPS):
            h = self._longest_step(point)
            if not flint.arb(point.c) - flint.arb(h) <= done:
                # a gap behind this interval: go nearer, or give up
                nearer = done + 0.9 * h
                if not done < nearer < point.c:
                    return None
                point = self.point(nearer)
                continue
            if not self.covers(point, h):
                return None
            turned += (point.det / last.det).arg()
            steps.append((point.c, h))
            last, done = point, math.nextafter(point.c + h, 0.0)
            if done >= end:
                return (steps, end) if self.without_roots(turned, last, end) else None
            point = self.point(done + h)
        return None

    def _longest_step(self, point: NormPoint) -> float:
        """Return the longest h that part A allows about a point, in floating point."""
        constants = [float(x) for x in (self.L1, self.L2, self.M1, self.M2)]
        sizes = [float(x) for x in point.sizes]
        level = float(self.level) * (1.0 - 1e-13)
        h = float(self.longest) * (1.0 - 1e-12) / (constants[0] * sizes[0])
        shorter = np.cumprod([h, *([0.75] * 40)])
        change = np.multiply.outer([1.0, -1.0], point.change)
        for some in np.split(shorter[:-1], _AT_ONCE):
            ends = point.gain + np.multiply.outer(some, change)
            tops = np.linalg.norm(ends, 2, axis=(2, 3)).max(axis=1)  # one call for several
            for step, top in zip(some, tops, strict=True):
                if top + 0.5 * step * step * bend(step, sizes, constants) < level:
                    return float(step)
        return float(shorter[-1])
