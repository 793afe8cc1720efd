"""How often det(I + L) turns about zero along the imaginary axis, poles on it passed on the right.

With f = det M of the closed loop over det M of the open one, f is det(I + L) but for a constant. Up
the axis its phase is followed (`phase`). At high frequency L is near its direct
part, and the phase that is left is a sum of principal values: no turn is hidden there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.core import NotAchievableError
from cosim.hinf.delay_lti.blocks import Blocks, Complexes, Reals, balanced_blocks
from cosim.hinf.delay_lti.high_frequency import HighFrequency
from cosim.hinf.delay_lti.phase import NotFollowedError, even_samples, log_derivative, turn_along
from cosim.hinf.delay_lti.roots import roots_of

_ON_AXIS = 1e-10  # real part of an open-loop pole that counts as on the axis, against its size
_SINGULAR = 1e-13  # the same, and M(0), against the largest
_DOUBLE = 2e-7  # a double pole, likewise
_INDENT = 1e-3  # radius about such a pole, against the distance to the next one
_ENOUGH = 64  # poles that are looked at
_INSIDE = 0.5  # what L may differ from its direct part at the ends


@dataclass(frozen=True, eq=False)
class Winding:
    """The count: closed-loop roots with Re s > 0 = clockwise turns + open-loop poles there.

    omega : where the phase was followed [rad/s], poles on the axis left out.
    """

    clockwise: int
    open_poles: int
    omega: Reals

    @property
    def closed_roots(self) -> int:
        """Number of roots of the closed loop with positive real part."""
        return self.clockwise + self.open_poles


class _Ratio:
    """f = det M_closed / det M_open; phase factor and f'/f."""

    def __init__(self, loop: Blocks) -> None:
        self.open = loop
        self.closed = loop.closed(-np.eye(loop.inputs))

    def at(self, s: Complexes) -> tuple[Complexes, Complexes]:
        (phase, slope), (pole_phase, pole_slope) = (
            log_derivative(blocks, s) for blocks in (self.closed, self.open)
        )
        return phase / pole_phase, slope - pole_slope


def winding_of(loop: Blocks) -> Winding:
    """Count the turns for the loop u = -L u + r, L square.

    Raises
    ------
    NotAchievableError : closed-loop roots on the axis, a direct part of one or more behind a
        delay (infinitely many roots right of any line, or as good as), or poles that cannot be
        found.
    """
    loop = balanced_blocks(loop)[0]
    ratio = _Ratio(loop)
    top = _top(loop)
    poles, right = _open_poles(loop)
    omega = np.zeros(0)
    total, start = 0.0, 0.0
    for i, pole in enumerate(poles):
        others = [abs(pole - x) for x in (*poles[:i], *poles[i + 1 :], -pole, top) if x != pole]
        radius = _INDENT * min([*others, 1.0 / max(loop.delays.max(initial=0.0), 1e-300)])
        if pole > 0.0:
            turned, points = _along_line(ratio, start, pole - radius)
            total, omega = total + turned, np.append(omega, points)
        begin = -0.5 * math.pi if pole > 0.0 else 0.0
        total += _along_arc(ratio, 1j * pole, radius, begin, 0.5 * math.pi)
        start = pole + radius
    turned, points = _along_line(ratio, start, top)
    total, omega = total + turned, np.append(omega, points)
    # f(conj s) = conj f(s): the lower half turns as much, and the arc at infinity goes back
    unwound = 2.0 * total - 2.0 * _end_phase(loop, top)
    turns = unwound / (2.0 * math.pi)
    if abs(turns - round(turns)) > 0.05:
        raise NotAchievableError(
            "the turns about -1 cannot be counted",
            where=f"up to {top:g} rad/s",
            expected="a whole number",
            got=f"{turns:.3f}: a closed-loop root on the axis, or next to it",
        )
    return Winding(-round(turns), right, omega)


def _top(loop: Blocks) -> float:
    """Return a frequency from which on L is within a half of its direct part, if that is less."""
    high = HighFrequency(loop)
    is_neutral = bool(loop.Dw.any() and loop.Dv.any())
    if is_neutral:
        top = high.last(0.5 * (1.0 + min(high.direct, 1.0)))
    else:
        inverse = np.linalg.inv(np.eye(loop.inputs) + loop.D)
        room = _INSIDE / max(float(np.linalg.norm(inverse, 2)), 1e-300)
        top = high.a + high.through / room if high.through_delays is not None else math.inf
    if not math.isfinite(top):
        raise NotAchievableError(
            "this loop has a direct part behind a delay that is not less than one",
            where="loop",
            expected="|L(j omega)| < 1 at high frequency",
            got=f"up to {high.direct:g}",
            hint="its closed loop has infinitely many roots with positive real part, or as good "
            "as; a filter in the loop ends that",
        )
    return top if top > 0.0 else 1.0 / float(loop.delays.max(initial=1.0))


def _open_poles(loop: Blocks) -> tuple[list[float], int]:
    """Return moduli of the open-loop poles on the axis, rising, and how many are right of it."""
    if not loop.order and not loop.is_neutral:
        return [], 0
    if (not loop.Bw.any() or not loop.Cv.any()) and not loop.is_neutral:
        poles = np.linalg.eigvals(loop.A).astype(np.complex128)
        scale = float(np.abs(loop.A).max(initial=0.0))
    else:
        count = min(_ENOUGH, loop.order + 8)
        poles = roots_of(loop, count)
        while poles[-1].real > -_ON_AXIS and count < 2 * _ENOUGH and poles.size >= count:
            count *= 2
            poles = roots_of(loop, count)
        scale = float(np.abs(poles).max(initial=0.0))
    # a double pole at zero is computed to the root of the precision only
    M, _ = loop.characteristic_matrix(0.0)
    sizes = np.linalg.svd(M, compute_uv=False)
    at_zero = (np.abs(poles) <= _DOUBLE * scale) & (sizes[-1] <= _SINGULAR * sizes[0])
    on_axis = at_zero | (np.abs(poles.real) <= _ON_AXIS * np.abs(poles) + _SINGULAR * scale)
    axis = np.where(at_zero, 0.0, poles.imag)[on_axis]
    merged: list[float] = []
    for value in sorted(set(np.abs(axis).tolist())):
        if not merged or value - merged[-1] > _DOUBLE * scale:
            merged.append(value)
    return merged, int(((poles.real > 0.0) & ~on_axis).sum())


def _along_line(ratio: _Ratio, low: float, high: float) -> tuple[float, Reals]:
    """Return the turn of f from j low to j high, and the frequencies used."""
    longest = float(ratio.open.delays.max(initial=0.0))
    even = even_samples(low, high, longest)
    fine = low + (high - low) * np.geomspace(1e-9, 1.0, 200)
    omega = np.union1d(even, fine)
    if low > 0.0:
        omega = np.union1d(omega, np.geomspace(low, high, 200))
    omega = np.clip(omega, low, high)
    return _followed(lambda x: (1j * x, 1j * np.ones_like(x)), np.unique(omega), ratio)


def _along_arc(ratio: _Ratio, centre: complex, radius: float, begin: float, end: float) -> float:
    """Return the turn of f along centre + radius e^{j theta}."""

    def path(theta: Reals) -> tuple[Complexes, Complexes]:
        turn = radius * np.exp(1j * theta)
        return centre + turn, 1j * turn

    return _followed(path, np.linspace(begin, end, 65), ratio)[0]


def _followed(path: Any, where: Reals, ratio: _Ratio) -> tuple[float, Reals]:
    """Return the turn of f along a path, and the parameters it was sampled at."""

    def sample(x: Reals) -> tuple[Complexes, Complexes]:
        s, ds = path(x)
        try:
            phase, slope = ratio.at(s)
        except np.linalg.LinAlgError:
            raise _on_axis(s) from None
        return phase, slope * ds

    try:
        return turn_along(sample, where)
    except NotFollowedError as error:
        raise _on_axis(path(np.array([error.where]))[0]) from None


def _on_axis(s: Complexes) -> NotAchievableError:
    return NotAchievableError(
        "the turns about -1 cannot be counted",
        where=f"{abs(complex(np.ravel(s)[0])):.6g} rad/s",
        expected="no root of the closed loop on the imaginary axis",
        hint="at this gain the loop is at the limit of stability",
    )


def _end_phase(loop: Blocks, top: float) -> float:
    """Return the phase of det(I + L(j top)) relative to that of its limit: principal values."""
    if not loop.inputs:
        return 0.0
    L = loop.at(1j * top)
    if loop.Dw.any() and loop.Dv.any():
        return float(np.angle(1.0 + np.linalg.eigvals(L)).sum())
    rest = np.linalg.solve(np.eye(loop.inputs) + loop.D, L - loop.D)
    return float(np.angle(1.0 + np.linalg.eigvals(rest)).sum())
