"""The wave field: an irregular sea that is exactly the exosystem w' = G w of the paper.

A sum of N harmonics with frequencies w_k, amplitudes a_k and phases p_k is the output of
G = blkdiag([0 w_k; -w_k 0]) from the initial state (a_k sin p_k, a_k cos p_k): block k moves
as (a_k sin(w_k t + p_k), a_k cos(w_k t + p_k)). It is evaluated in this closed form, without
drift and for any step size.

Amplitudes and frequencies follow a sea spectrum (T. I. Fossen, Handbook of Marine Craft
Hydrodynamics and Motion Control, Wiley 2011, ch. 8). With x = w / w_p, w_p = 2 pi / Tp:

    S(w) = c (5/16) Hs^2 w_p^4 w^-5 exp(-5/4 x^-4) g^Y
    Y    = exp(-(x - 1)^2 / (2 s^2)),  s = 0.07 for x <= 1 and 0.09 above

g = 1 is Pierson-Moskowitz (c = 1), g = 3.3 the usual JONSWAP; c makes the variance Hs^2/16.

At depth z in deep water a harmonic of elevation amplitude a accelerates the water by
w^2 a exp(-w^2 z / g0), horizontally along the direction of travel and, a quarter period
apart, vertically (linear theory: particles go round in circles).

Modelling choice: the force on a neutrally buoyant body that is small against the wave length is
(m + added mass) times the acceleration of the water, so that the body moves with the water: the
acceleration of the water is added to nu'. Limits: the speed of the water is left out of the
hydrodynamic force h(nu), as are changes of heading and position of the vehicle (direction is
relative to its bow, the field is that at one point) and waves of a few body lengths or less.
Yaw comes from the uneven sway acceleration along the hull, here a gain on it.

Written once for scalars, with functions from a given namespace (floats, arrays, symbols).
Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from cosim.models.products import total

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s^2]."""

PEAK_FACTOR: Mapping[str, float] = MappingProxyType({"jonswap": 3.3, "pierson-moskowitz": 1.0})
"""Usual peak factor g by name of the spectrum."""

LOWEST, HIGHEST = 0.5, 3.0
"""Frequencies used, as multiples of the peak's. Below lies 2e-9 of the energy (g = 1), above
1.5 %; the amplitudes make up for both. Without an upper end the acceleration of the surface
has no finite variance."""

_Q_LOW, _Q_PEAK, _Q_HIGH = (math.exp(-1.25 * x**-4) for x in (LOWEST, 1.0, HIGHEST))
_S_BELOW, _S_ABOVE = 0.07, 0.09  # s of the spectrum

_MASK = 0xFFFFFFFFFFFFFFFF


class Component(NamedTuple):
    """One harmonic, amplitude * sin(omega t + phase) [rad/s, any unit, rad]."""

    omega: Any
    amplitude: Any
    phase: Any


class Gains(NamedTuple):
    """Gains from the acceleration of the water to those of u, v, w [1] and r [rad/m]."""

    u: Any
    v: Any
    w: Any
    r: Any


def splitmix64(state: int) -> tuple[int, int]:
    """Advance the random generator; return the next state and a 64-bit output.

    G. L. Steele, D. Lea, C. H. Flood, "Fast splittable pseudorandom number generators",
    OOPSLA 2014, with the constants of S. Vigna's reference code. Integers only: the same
    numbers on every machine and in every language.
    """
    state = (state + 0x9E3779B97F4A7C15) & _MASK
    z = state
    z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
    return state, z ^ (z >> 31)


def uniforms(seed: int, count: int) -> list[float]:
    """Draw `count` numbers in [0, 1), the upper 53 bits of each output of `splitmix64`.

    Raises
    ------
    ValueError : if the seed is not an integer of 64 bits.
    """
    if not 0 <= seed <= _MASK:
        raise ValueError(f"seed of the wave field: expected 0 to 2^64 - 1, got {seed}")
    state, drawn = seed, []
    for _ in range(count):
        state, bits = splitmix64(state)
        drawn.append((bits >> 11) * 2.0**-53)
    return drawn


def discretise(
    Hs: Any, Tp: Any, peak_factor: Any, drawn: Sequence[Any], ns: Any = math
) -> list[Component]:
    """Return the elevation of the sea as N harmonics; the sum of a_k^2 / 2 is Hs^2/16.

    The share of the Pierson-Moskowitz energy below x is q(x) = exp(-5/4 x^-4), so bins of
    equal energy have edges in closed form. One frequency is drawn in each bin, so that the sea
    does not repeat; it gets the energy of the bin times g^Y. The peak is an edge of the bins:
    the index of a frequency tells its side (s = 0.07 or 0.09), also for symbols.

    Parameters
    ----------
    Hs : significant wave height [m].
    Tp : peak period [s].
    peak_factor : g of the spectrum [1].
    drawn : 2 N numbers in [0, 1): place in the bin and phase / 2 pi, for each harmonic.
    ns : namespace with `exp`, `log` and `sqrt`.
    """
    count = len(drawn) // 2
    below = bins_below_peak(count)
    drawn_bins = [
        lower_bin(k, below, drawn[2 * k], Tp, peak_factor, ns)
        if k < below
        else upper_bin(k, below, count, drawn[2 * k], Tp, peak_factor, ns)
        for k in range(count)
    ]
    energy = total(e for _, e in drawn_bins)
    return [
        harmonic(omega, bin_, energy, Hs, drawn[2 * k + 1], ns)
        for k, (omega, bin_) in enumerate(drawn_bins)
    ]


def bins_below_peak(count: int) -> int:
    """Return how many of `count` bins of equal energy lie below the peak."""
    return round(count * (_Q_PEAK - _Q_LOW) / (_Q_HIGH - _Q_LOW))


def lower_bin(
    k: Any, below: Any, drawn: Any, Tp: Any, peak_factor: Any, ns: Any
) -> tuple[Any, Any]:
    """Return frequency [rad/s] and energy of bin `k` of the `below` bins below the peak."""
    width = (_Q_PEAK - _Q_LOW) / below
    return _in_bin(_Q_LOW, width, k + drawn, _S_BELOW, Tp, peak_factor, ns)


def upper_bin(
    k: Any, below: Any, count: Any, drawn: Any, Tp: Any, peak_factor: Any, ns: Any
) -> tuple[Any, Any]:
    """Return frequency [rad/s] and energy of bin `k` above the peak, `below` of `count` below."""
    width = (_Q_HIGH - _Q_PEAK) / (count - below)
    return _in_bin(_Q_PEAK, width, k - below + drawn, _S_ABOVE, Tp, peak_factor, ns)


def _in_bin(
    start: float, width: Any, place: Any, s: float, Tp: Any, peak_factor: Any, ns: Any
) -> tuple[Any, Any]:
    x = ns.sqrt(ns.sqrt(-1.25 / ns.log(start + width * place)))
    enhancement = ns.exp(-((x - 1) ** 2) / (2 * s * s))
    return x * (2 * math.pi / Tp), width * ns.exp(ns.log(peak_factor) * enhancement)


def harmonic(omega: Any, bin_: Any, energy: Any, Hs: Any, drawn: Any, ns: Any) -> Component:
    """Return the harmonic of a bin with `bin_` of all `energy`, its phase drawn in [0, 1)."""
    return Component(omega, Hs / 4 * ns.sqrt(2 * bin_ / energy), 2 * math.pi * drawn)


def sea(
    Hs: float,
    Tp: float,
    *,
    spectrum: str = "jonswap",
    peak_factor: float | None = None,
    count: int = 20,
    seed: int = 1,
) -> list[Component]:
    """Return the elevation of an irregular sea; equal arguments give it bit for bit.

    Parameters
    ----------
    Hs, Tp : significant wave height [m] and peak period [s].
    spectrum : "jonswap" or "pierson-moskowitz".
    peak_factor : g, for a JONSWAP other than the usual 3.3 (1 to 10).
    count : number of harmonics N.
    seed : draws frequencies (within their bins) and phases.

    Raises
    ------
    ValueError : on an argument outside its range.
    """
    if not (math.isfinite(Hs) and Hs >= 0):
        raise ValueError(f"significant wave height Hs: expected a number >= 0 [m], got {Hs}")
    if not (math.isfinite(Tp) and Tp > 0):
        raise ValueError(f"peak period Tp: expected a number > 0 [s], got {Tp}")
    if spectrum not in PEAK_FACTOR:
        raise ValueError(f"spectrum: expected one of {sorted(PEAK_FACTOR)}, got {spectrum!r}")
    factor = PEAK_FACTOR[spectrum] if peak_factor is None else peak_factor
    if not 1 <= factor <= 10:
        raise ValueError(f"peak factor: expected 1 to 10, got {factor}")
    if spectrum == "pierson-moskowitz" and factor != 1:
        raise ValueError(f"peak factor of a Pierson-Moskowitz spectrum: expected 1, got {factor}")
    if count < 1:
        raise ValueError(f"number of wave components: expected at least 1, got {count}")
    return discretise(Hs, Tp, factor, uniforms(seed, 2 * count))


def at_depth(elevation: Sequence[Component], depth: Any, ns: Any = math) -> list[Component]:
    """Return the acceleration of the water [m/s^2] `depth` [m] below the mean surface."""
    return [acceleration_at_depth(c, depth, ns) for c in elevation]


def acceleration_at_depth(c: Component, depth: Any, ns: Any) -> Component:
    """Return `at_depth` of one harmonic, for deep water."""
    return Component(
        c.omega, c.omega**2 * c.amplitude * ns.exp(-(c.omega**2) * depth / GRAVITY), c.phase
    )


def gains(direction: Any, yaw_gain: Any, ns: Any = math) -> Gains:
    """Return the gains of waves towards `direction` [rad] from the bow, starboard positive.

    `yaw_gain` [rad/s^2 per m/s^2] times the sway acceleration is the yaw acceleration.
    """
    sway = ns.sin(direction)
    return Gains(ns.cos(direction), sway, 1.0, yaw_gain * sway)


def accelerations(
    t: Any, components: Sequence[Component], gain: Gains, ns: Any = math
) -> list[Any]:
    """Return the disturbance of u, v, w [m/s^2] and r [rad/s^2] at time `t` [s].

    The acceleration of the water is the sum of a_k sin(w_k t + p_k) along the direction of travel,
    and minus the sum of a_k cos(w_k t + p_k) downwards (z points down). `components` come from
    `at_depth`, or are given: (1, 1, 0) alone with gain 1 on u is exactly sin t, the disturbance
    of section 5. `ns` provides `sin` and `cos`.
    """
    along: Any = 0.0
    down: Any = 0.0
    for c in components:
        along, down = with_harmonic(along, down, t, c, ns)
    return shares(along, down, gain)


def with_harmonic(along: Any, down: Any, t: Any, c: Component, ns: Any) -> tuple[Any, Any]:
    """Add one harmonic to the accelerations along the direction of travel and downwards."""
    angle = c.omega * t + c.phase
    return along + c.amplitude * ns.sin(angle), down - c.amplitude * ns.cos(angle)


def shares(along: Any, down: Any, gain: Gains) -> list[Any]:
    """Return the disturbance of u, v, w [m/s^2] and r [rad/s^2] with these gains."""
    return [gain.u * along, gain.v * along, gain.w * down, gain.r * along]
