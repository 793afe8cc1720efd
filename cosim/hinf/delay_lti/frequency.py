"""Bode and Nyquist data of systems with internal delays: exact at every frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.delay_lti.blocks import Blocks, Complexes, Reals
from cosim.hinf.delay_lti.closed_loop import ClosedLoop
from cosim.hinf.delay_lti.margins import Margins
from cosim.hinf.delay_lti.winding import Winding

_POINTS = 1000
_CHANGE = 0.1  # of phase [rad] between the points of a Nyquist curve, as far as it is drawn
_LARGEST = 1e3  # |L| from which a Nyquist curve is not refined


@dataclass(frozen=True, eq=False, repr=False)
class FrequencyResponse:
    """G(j omega): `omega` (k,) [rad/s], `response` (p, m, k), as of python-control's FRD.

    margins : of a loop, where they were asked for; drawn into the picture.
    """

    omega: Reals
    response: Complexes
    margins: Margins | None = None

    @property
    def magnitude(self) -> Reals:
        """|G| of every entry, (p, m, k); (k,) where there is one."""
        return _squeezed(np.abs(self.response))

    @property
    def phase(self) -> Reals:
        """Phase [rad] without jumps of 2 pi, (p, m, k); (k,) where there is one."""
        return _squeezed(np.unwrap(np.angle(self.response), axis=-1))

    def __iter__(self) -> Iterator[Reals]:
        return iter((self.magnitude, self.phase, self.omega))

    def __repr__(self) -> str:
        gains = np.linalg.norm(np.moveaxis(self.response, -1, 0), 2, axis=(1, 2))
        k = int(np.argmax(gains))
        return (
            f"<FrequencyResponse: {self.omega.size} points from {self.omega[0]:.4g} to "
            f"{self.omega[-1]:.4g} rad/s, greatest gain {gains[k]:.4g} at {self.omega[k]:.4g}>"
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw magnitude [dB] and phase [deg]; return matplotlib's two axes.

        Raises
        ------
        InputError : matplotlib is not installed.
        """
        from cosim.hinf.delay_lti.pictures import draw_bode  # noqa: PLC0415 - matplotlib

        return draw_bode(self, ax)


@dataclass(frozen=True, eq=False, repr=False)
class Nyquist:
    """The Nyquist curve of a loop L, and what it says of u = r - L u.

    Attributes
    ----------
    omega : (k,) [rad/s]; poles on the axis are passed on their right.
    response : det(I + L) - 1 there, which is L where there is one input and output.
    encirclements : of -1, clockwise, over the whole imaginary axis.
    open_poles : of L with positive real part.
    closed_roots : of the closed loop with positive real part: encirclements + open_poles.
    """

    omega: Reals
    response: Complexes
    encirclements: int
    open_poles: int
    closed_roots: int

    @property
    def stable(self) -> bool:
        """Whether the closed loop has no root with positive real part."""
        return self.closed_roots == 0

    def __repr__(self) -> str:
        verdict = "stable" if self.stable else "unstable"
        return (
            f"<Nyquist: {self.encirclements} clockwise encirclements of -1 + "
            f"{self.open_poles} open-loop poles on the right = {self.closed_roots} closed-loop "
            f"roots on the right: {verdict}>"
        )

    def plot(self, ax: Any = None) -> Any:
        """Draw the curve and its mirror image; return matplotlib's axes.

        Raises
        ------
        InputError : matplotlib is not installed.
        """
        from cosim.hinf.delay_lti.pictures import draw_nyquist  # noqa: PLC0415 - matplotlib

        return draw_nyquist(self, ax)


def frequency_response(loop: ClosedLoop | Blocks, omega: ArrayLike) -> Complexes:
    """Return G(j omega) from w to z, (p, q, len(omega)), exact at each frequency.

    Parameters
    ----------
    loop : a loop with w and z, see `close`, or a system with internal delays.
    omega : frequencies [rad/s].

    Raises
    ------
    InputError : a loop without w or z, omega not finite, or at a root of the loop.
    """
    try:
        values = loop.transfer(_checked(omega))
    except np.linalg.LinAlgError as error:
        raise InputError("a frequency at which the system has a pole", where="omega") from error
    return np.moveaxis(values, 0, -1)


def frequency_response_of(
    blocks: Blocks, omega: ArrayLike | None, margins: Margins | None = None
) -> FrequencyResponse:
    """Return G(j omega) at these frequencies [rad/s]; None: where something happens.

    Raises
    ------
    InputError : frequencies that are none, or that of a pole.
    """
    points = frequencies_of(blocks) if omega is None else _checked(omega)
    return FrequencyResponse(points, frequency_response(blocks, points), margins)


def nyquist_of(loop: Blocks, winding: Winding, omega: ArrayLike | None = None) -> Nyquist:
    """Return the curve of a square loop at these frequencies, or at those it needs."""
    if omega is None:
        points = np.union1d(frequencies_of(loop), _thinned(winding.omega[winding.omega > 0.0]))
        points = _refined(loop, points)
    else:
        points = _checked(omega)
    try:
        values = _determinant(loop, points)
    except np.linalg.LinAlgError as error:
        raise InputError("a frequency at which the loop has a pole", where="omega") from error
    return Nyquist(points, values, winding.clockwise, winding.open_poles, winding.closed_roots)


def _determinant(loop: Blocks, omega: Reals) -> Complexes:
    return_difference = np.eye(loop.inputs) + loop.at(1j * omega)
    return np.asarray(np.linalg.det(return_difference) - 1.0, dtype=np.complex128)


def _refined(loop: Blocks, omega: Reals) -> Reals:
    """Return the frequencies with more where the curve turns quickly."""
    for _ in range(8):
        values = _determinant(loop, omega)
        steps = np.abs(np.diff(values))
        size = np.minimum(np.abs(values[1:]), np.abs(values[:-1]))
        split = np.flatnonzero((steps > _CHANGE * np.maximum(size, _CHANGE)) & (size < _LARGEST))
        if not split.size or omega.size > 20 * _POINTS:
            break
        omega = np.insert(omega, split + 1, np.sqrt(omega[split] * omega[split + 1]))
    return omega


def _thinned(omega: Reals) -> Reals:
    step = max(1, omega.size // _POINTS)
    return omega[::step]


def frequencies_of(blocks: Blocks) -> Reals:
    """Return frequencies [rad/s] from well below the slowest mode to well above the fastest."""
    speeds = np.abs(np.linalg.eigvals(blocks.A + blocks.Bw @ blocks.Cv)) if blocks.order else []
    speeds = np.concatenate([speeds, np.abs(np.linalg.eigvals(blocks.A)), 1.0 / blocks.delays])
    speeds = speeds[speeds > 1e-9 * speeds.max(initial=0.0)]
    low, high = (float(speeds.min()), float(speeds.max())) if speeds.size else (1.0, 1.0)
    first, last = math.floor(math.log10(low) - 1.0), math.ceil(math.log10(high) + 1.0)
    return np.logspace(first, last, max(_POINTS, 200 * (last - first)))


def _checked(omega: ArrayLike) -> Reals:
    try:
        points = np.asarray(omega, dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputError("not frequencies", where="omega", expected="numbers of rad/s") from error
    if not points.size or not np.isfinite(points).all():
        raise InputError("not frequencies", where="omega", expected="finite numbers of rad/s")
    return points


def _squeezed(values: Any) -> Reals:
    return np.asarray(values[0, 0] if values.shape[:2] == (1, 1) else values)
