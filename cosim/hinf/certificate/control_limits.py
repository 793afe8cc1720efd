"""Proved limits of the control: a bound on |K|, and bounds on every |u_i(t)|.

**Gain.** |K| <= k, the largest singular value, is k^2 I - K K' >= 0 with the deployed K; the
proof needs no LMI.

**Peak.** Without z, the LMI of `cosim.hinf.theorems.theorem_2` at some mu (its gamma) implies
V' <= mu w'w for the functional V and every admissible F(t). From an initial state x0, constant
before t = 0 (the terms of x' in V are zero then), and with a disturbance of finite energy,

    x(t)'P x(t) <= V(t) <= x0'(P + sum_j dj Qj) x0 + mu int w'w,    P = X^-1, Qj = P Qbar_j P

for every t > 0, and before it. With |x0_i| <= offset_i the first term is largest at a corner
of that box, since it is convex; int w'w <= energy^2. For u = K x(t-d_f)

    u_i^2 <= K_i X K_i' times that level,

all of it in rational numbers. X, Qbar, R, eps and mu are independent of those that prove gamma.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any

import flint
import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate.guarantee import NUMBER, Form, Guarantee, Read, numbers
from cosim.hinf.certificate.theorem_2_json import theorem_2_from_json, theorem_2_to_json
from cosim.hinf.certificate.unknowns_json import numbers_from_json, numbers_to_json
from cosim.hinf.exact import (
    ball_precision,
    exact,
    exact_matrix,
    from_text,
    norm_is_below,
    root_above,
    rounded_up,
)
from cosim.hinf.theorems import Proof
from cosim.models import DelaySystem, Matrix

MAX_OFFSETS = 8
"""Most states that may start away from zero: 2^7 corners of a box, up to their sign."""

_PRECISIONS = (256, 512, 1024, 2048, 4096)  # bits
_DIGITS = 50  # bits of a level that must be sure


@dataclass(frozen=True, eq=False)
class GainLimit(Guarantee):
    """The largest singular value of K is at most `bound`, a `fmpq`."""

    bound: Any

    NAME = "gain_limit"
    FORMS = MappingProxyType({"bound": NUMBER})
    CLAIMED = ("bound",)

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return why it is not proved; None if it is."""
        del system
        K = exact_matrix(gain)
        if self.bound < 0:
            return "the bound of |K| is negative"
        return None if norm_is_below(K, self.bound) else "bound^2 I - K K' is not positive definite"


def norm_above(gain: Matrix) -> float:
    """Return a double just above |K|, for which `GainLimit` is proved."""
    value = float(np.linalg.norm(gain, 2)) if gain.size else 0.0
    value = rounded_up(value) if value > 0 else math.ulp(1.0)
    while GainLimit(exact(value)).failure(DelaySystem([[0.0]]), gain) is not None:
        value *= 1 + 1e-12
    return value


def _offset(data: Any, of: Read) -> tuple[Any, ...]:
    offset = numbers_from_json(data, len(of.system.A), of.where)
    sides = sum(value != 0 for value in offset)
    if sides > MAX_OFFSETS:
        raise too_many_offsets(sides, of.where)
    return offset


def _energy(data: Any, of: Read) -> Any:
    energy = from_text(data, of.where)
    if energy != 0 and not of.system.C.size:
        raise InputError(
            "does not fit the system", where=of.where, expected="0, without a disturbance"
        )
    return energy


def _variables(data: Any, of: Read) -> Proof:
    acts = of.values["energy"] != 0
    bare = peak_system(of.system, energy=acts)
    return theorem_2_from_json(bare, of.gain, data, of.where, bounded=acts)


@dataclass(frozen=True, eq=False)
class PeakControl(Guarantee):
    """Bounds |u_i(t)| <= bound_i for every t, with their proof: exact numbers (`fmpq`).

    bounds : one per input.
    offset : one per state; the initial state has |x_i| <= offset_i, constant before t = 0.
    energy : int w'w <= energy^2.
    proof : by Theorem 2 without z; its gamma, mu above, is None where the energy is zero.
    """

    bounds: tuple[Any, ...]
    offset: tuple[Any, ...]
    energy: Any
    proof: Proof

    NAME = "peak_control"
    FORMS = MappingProxyType(
        {
            "bounds": numbers(lambda of: of.system.B.shape[1]),
            "offset": Form(numbers_to_json, _offset),
            "energy": Form(NUMBER.write, _energy),
            "variables": Form(theorem_2_to_json, _variables),
        }
    )
    CLAIMED = ("bounds", "offset", "energy")

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return which condition is not proved; None if all are."""
        if self.energy < 0 or any(value < 0 for value in (*self.bounds, *self.offset)):
            return "a bound, an offset or the energy is negative"
        reason = self.proof.failure(peak_system(system, energy=self.energy != 0), gain)
        if reason is not None:
            return reason
        squares = squared_peaks(system, gain, self.proof, self.offset, self.energy)
        if squares is None:
            return "X is as good as singular"
        for i, (bound, square) in enumerate(zip(self.bounds, squares, strict=True)):
            if not _square_is_above(bound, square):
                return f"bounds[{i}] is not proved: {float(bound):.6g} is below the level reached"
        return None


def peak_system(system: DelaySystem, *, energy: bool) -> DelaySystem:
    """Return the system with z = 0; also without w where there is no energy."""
    s = system
    C = s.C if energy else s.C[:, :0]
    D, D1, D2 = (np.zeros((int(energy), M.shape[1])) for M in (s.A, C, s.B))
    return replace(s, C=C, D=D, D1=D1, D2=D2)


def squared_peaks(
    system: DelaySystem, gain: Matrix, proof: Proof, offset: tuple[Any, ...], energy: Any
) -> tuple[Any, ...] | None:
    """Return bounds of every u_i^2, as balls (`flint.arb`); None for a nearly singular X."""
    K, X = exact_matrix(gain), proof.unknowns["X"]
    weights = X
    for j, delay in enumerate(system.delays):
        weights = weights + exact(delay.d) * proof.unknowns[f"Q[{j}]"]
    corners = offset_corners(offset)
    n = len(offset)
    starts = flint.fmpq_mat(n, len(corners), [corner[i] for i in range(n) for corner in corners])
    KXK = K * X * K.transpose()
    for bits in _PRECISIONS:
        with ball_precision(bits):
            level = flint.arb(0)
            if corners:
                try:
                    p = flint.arb_mat(X).solve(flint.arb_mat(starts))
                except ZeroDivisionError:
                    continue
                levels = p.transpose() * flint.arb_mat(weights) * p
                for k in range(len(corners)):
                    level = level.max(levels[k, k])
            if energy != 0:
                level += flint.arb(proof.gamma * energy * energy)
            squares = tuple(level * flint.arb(KXK[i, i]) for i in range(K.nrows()))
            if all(square == 0 or square.rel_accuracy_bits() > _DIGITS for square in squares):
                return squares
    return None


def offset_corners(offset: tuple[Any, ...]) -> list[tuple[Any, ...]]:
    """Return one of each pair of opposite corners of |x_i| <= offset_i; [] if the box is 0.

    Raises
    ------
    InputError : more than `MAX_OFFSETS` of its sides are not zero.
    """
    sides = [i for i, value in enumerate(offset) if value != 0]
    if len(sides) > MAX_OFFSETS:
        raise too_many_offsets(len(sides), "offset")
    corners = []
    for signs in half_of_corners(len(sides)):
        corner = list(offset)
        for i, sign in zip(sides, signs, strict=True):
            corner[i] = sign * corner[i]
        corners.append(tuple(corner))
    return corners if sides else []


def half_of_corners(count: int) -> list[tuple[int, ...]]:
    """Return one of each pair of opposite corners of the cube [-1, 1]^count."""
    return [signs[:count] for signs in itertools.product((1,), *[(1, -1)] * (count - 1))]


def too_many_offsets(sides: int, where: str) -> InputError:
    """Return the error for an offset with more than `MAX_OFFSETS` sides that are not zero."""
    return InputError(
        "too many states start away from zero",
        where=where,
        expected=f"at most {MAX_OFFSETS} numbers above zero",
        got=str(sides),
    )


def proved_peaks(
    system: DelaySystem, gain: Matrix, proof: Proof, offset: tuple[Any, ...], energy: Any
) -> tuple[float, ...] | None:
    """Return the least bounds that prove a `PeakControl`, rounded up to seven digits."""
    squares = squared_peaks(system, gain, proof, offset, energy)
    if squares is None:
        return None
    return tuple(
        root_above(float(square.upper()), partial(_square_is_above, square=square))
        for square in squares
    )


def _square_is_above(bound: Any, square: Any) -> bool:
    with ball_precision(_PRECISIONS[0]):
        return bool(flint.arb(bound * bound) >= square)
