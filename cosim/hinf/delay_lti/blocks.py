"""A linear system with internal delays, as a rational part closed over its delays.

    x'(t) = A x + B u + Bw w
    y(t)  = C x + D u + Dw w
    v(t)  = Cv x + Dv u + Dvw w,    w_i(t) = v_i(t - tau_i),  tau_i > 0

The linear fractional form of MATLAB's state-space models with internal delays: series, parallel
and feedback connections of such systems are such systems, whatever the delays, so that nothing
is approximated. With E(s) = diag(e^{-s tau_i}) the transfer function is

    G(s) = D + [C  Dw E] M(s)^-1 [B; Dv],   M(s) = [s I - A, -Bw E; -Cv, I - Dvw E],

and the zeros of det M are the characteristic roots. The rows of v are not eliminated before M is
inverted: an integrator inside a loop then has no singular response of its own at s = 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError

Reals = NDArray[np.float64]
"""Real numbers, of any shape."""
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, repr=False)
class Blocks:
    """The matrices of a system with N internal delays; `Blocks.of` checks and simplifies them.

    A (n, n), B (n, m), C (p, n), D (p, m), Bw (n, N), Dw (p, N), Cv (N, n), Dv (N, m),
    Dvw (N, N), delays (N,) [s].
    """

    A: Reals
    B: Reals
    C: Reals
    D: Reals
    Bw: Reals
    Dw: Reals
    Cv: Reals
    Dv: Reals
    Dvw: Reals
    delays: Reals

    @property
    def order(self) -> int:
        """Number n of states beside what the delays contain."""
        return int(self.A.shape[0])

    @property
    def inputs(self) -> int:
        """Number m of inputs."""
        return int(self.D.shape[1])

    @property
    def outputs(self) -> int:
        """Number p of outputs."""
        return int(self.D.shape[0])

    @property
    def matrices(self) -> dict[str, Reals]:
        """Every matrix and `delays` by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def characteristic_matrix(self, s: Any) -> tuple[Complexes, Complexes]:
        """Return M(s) and dM/ds, each s.shape + (n + N, n + N)."""
        s = np.asarray(s, dtype=np.complex128)
        n, N = self.order, self.delays.size
        phases = np.exp(-s[..., None] * self.delays)
        from_w = np.vstack([self.Bw, self.Dvw])
        M = np.zeros((*s.shape, n + N, n + N), dtype=np.complex128)
        M[..., :n, :n] = s[..., None, None] * np.eye(n) - self.A
        M[..., n:, :n] = -self.Cv
        M[..., n:] = -from_w * phases[..., None, :]
        M[..., n:, n:] += np.eye(N)
        slope = np.zeros_like(M)
        slope[..., :n, :n] = np.eye(n)
        slope[..., n:] = from_w * (self.delays * phases)[..., None, :]
        return M, slope

    def bound(self, real: float) -> float:
        """Return a bound of the terms of M(s) but s, Re s >= real [1/s]."""
        delayed = np.abs(np.vstack([self.Bw, self.Dvw])).sum(axis=0) @ np.exp(-real * self.delays)
        return float(1.0 + np.abs(self.A).sum() + np.abs(self.Cv).sum() + delayed)

    def resolvent(self, s: Complexes) -> tuple[Complexes, Complexes, Complexes]:
        """Return S = M^-1, S [B; Dv] and [C  Dw E] S at s (k,)."""
        S = np.asarray(np.linalg.inv(self.characteristic_matrix(s)[0]), dtype=np.complex128)
        phases = np.exp(-s[:, None] * self.delays)
        now = np.broadcast_to(self.C, (s.size, *self.C.shape))
        out = np.concatenate([now, self.Dw * phases[:, None, :]], axis=2)
        S_in: Complexes = S @ np.vstack([self.B, self.Dv])
        out_S: Complexes = out @ S
        return S, S_in, out_S

    @property
    def direct(self) -> Reals:
        """G at infinite frequency, (p, m); zero where it tends to nothing there."""
        return 0.0 * self.D if self.Dw.any() and self.Dv.any() else self.D

    def transfer(self, omega: ArrayLike) -> Complexes:
        """Return G(j omega), omega.shape + (p, m); otherwise as `at`."""
        return self.at(1j * np.asarray(omega, dtype=np.float64))

    def at(self, s: Any) -> Complexes:
        """Return G(s), s.shape + (p, m), for complex s of any shape.

        Raises
        ------
        numpy.linalg.LinAlgError : s is a characteristic root.
        """
        s = np.asarray(s, dtype=np.complex128)
        M, _ = self.characteristic_matrix(s)
        phases = np.exp(-s[..., None] * self.delays)
        if not M.shape[-1]:
            return np.broadcast_to(self.D, (*s.shape, *self.D.shape)).astype(np.complex128)
        right = np.vstack([self.B, self.Dv]).astype(np.complex128)
        inner = np.linalg.solve(M, np.broadcast_to(right, (*s.shape, *right.shape)))
        n = self.order
        late_part = (self.Dw * phases[..., None, :]) @ inner[..., n:, :]
        return np.asarray(self.C @ inner[..., :n, :] + late_part + self.D, dtype=np.complex128)

    @property
    def is_neutral(self) -> bool:
        """Whether a signal meets itself again through delays alone, past every state.

        Then derivatives depend on late derivatives, and discontinuities never smooth out.
        """
        power = self.Dvw != 0.0
        for _ in range(power.shape[0]):
            if not power.any():
                return False
            power = (power.astype(int) @ (self.Dvw != 0.0).astype(int)) > 0
        return bool(power.any())

    def closed(self, F: ArrayLike) -> Blocks:
        """Return the system with u = F y + r, r the new input, F (m, p) a constant gain.

        Raises
        ------
        InputError : an algebraic loop without delay that has no solution.
        """
        gain = np.asarray(F, dtype=np.float64)
        loop = np.eye(self.outputs) - self.D @ gain
        singular = np.linalg.svd(loop, compute_uv=False)
        if singular.size and singular[-1] <= 1e-14 * max(1.0, singular[0]):
            raise InputError(
                "this feedback has no solution: direct terms cancel in a loop without delay",
                where="feedback",
                expected="I - D F invertible",
                got=f"a least singular value of {singular[-1]:.3g}",
                hint="a small delay or a fast filter in the loop, or another gain",
            )
        MC, MDw, MD = (
            np.asarray(np.linalg.solve(loop, X), dtype=np.float64)
            for X in (self.C, self.Dw, self.D)
        )
        into = np.eye(self.inputs) + gain @ MD
        delayed, now = gain @ MDw, gain @ MC
        return Blocks(
            A=self.A + self.B @ now,
            B=self.B @ into,
            C=MC,
            D=MD,
            Bw=self.Bw + self.B @ delayed,
            Dw=MDw,
            Cv=self.Cv + self.Dv @ now,
            Dv=self.Dv @ into,
            Dvw=self.Dvw + self.Dv @ delayed,
            delays=self.delays,
        )

    def between(self, left: ArrayLike, right: ArrayLike) -> Blocks:
        """Return the system left G right, with constant matrices (p', p) and (m, m')."""
        out, into = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
        matrices = self.matrices
        matrices |= {"C": out @ self.C, "Dw": out @ self.Dw, "D": out @ self.D @ into}
        return Blocks(**matrices | {"B": self.B @ into, "Dv": self.Dv @ into})

    def transposed(self) -> Blocks:
        """Return the system with G(s)' for G(s): the same roots and the same norm."""
        return Blocks(
            A=self.A.T,
            B=self.C.T,
            C=self.B.T,
            D=self.D.T,
            Bw=self.Cv.T,
            Dw=self.Dv.T,
            Cv=self.Bw.T,
            Dv=self.Dw.T,
            Dvw=self.Dvw.T,
            delays=self.delays,
        )

    def simplified(self) -> Blocks:
        """Return the same system without delays of zero, and with as few channels as is plain.

        Channels that nothing enters or leaves are left out, channels of the same signal and
        delay merged, and a delay that only feeds another delay joined to it.
        """
        blocks = _without_zero_delays(self)
        while True:
            fewer = _merged(_used(blocks))
            if fewer.delays.size == blocks.delays.size:
                return _chained(fewer)
            blocks = fewer


def blocks_from(
    given: Mapping[str, ArrayLike], shapes: tuple[int, int, int], where: str = "system"
) -> Blocks:
    """Return checked blocks of the matrices that are given; absent ones are zero.

    Parameters
    ----------
    given : matrices by their names in `Blocks`, and `delays`.
    shapes : n, m, p.
    where : for messages.

    Raises
    ------
    InputError : a matrix that does not fit, numbers that are not finite, a negative delay.
    """
    n, m, p = shapes
    delays = np.atleast_1d(np.asarray(given.get("delays", ()), dtype=np.float64))
    for i, d in enumerate(delays.tolist()):
        if not (math.isfinite(d) and d >= 0.0):
            raise InputError(
                "not a delay", where=f"{where}: delays[{i}]", expected="seconds >= 0", got=repr(d)
            )
    N = delays.size
    sizes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m), "Bw": (n, N), "Dw": (p, N)}
    sizes |= {"Cv": (N, n), "Dv": (N, m), "Dvw": (N, N)}
    matrices = {}
    for name, shape in sizes.items():
        matrix = np.array(given.get(name, np.zeros(shape)), dtype=np.float64)
        if matrix.shape != shape or not np.isfinite(matrix).all():
            raise InputError(
                "a matrix that does not fit",
                where=f"{where}: {name}",
                expected=f"finite numbers, shape {shape}",
                got="nan or infinity" if matrix.shape == shape else str(matrix.shape),
            )
        matrices[name] = matrix
    return Blocks(**matrices, delays=delays).simplified()


def beside(*systems: Blocks) -> Blocks:
    """Return the block-diagonal system of these: all inputs, all outputs, nothing connected."""

    def diagonal(name: str) -> Reals:
        same = [getattr(one, name) for one in systems]
        diagonals = np.zeros((sum(M.shape[0] for M in same), sum(M.shape[1] for M in same)))
        row = column = 0
        for M in same:
            diagonals[row : row + M.shape[0], column : column + M.shape[1]] = M
            row, column = row + M.shape[0], column + M.shape[1]
        return diagonals

    names = [field.name for field in fields(Blocks) if field.name != "delays"]
    delays = np.concatenate([one.delays for one in systems])
    return Blocks(**{name: diagonal(name) for name in names}, delays=delays)


def balanced_blocks(blocks: Blocks) -> tuple[Blocks, Reals]:
    """Return the same response with states x / scale, powers of two that balance A; and scale."""
    if not blocks.order:
        return blocks, np.ones(0)
    through = np.abs(blocks.A) + np.abs(blocks.Bw) @ np.abs(blocks.Cv)
    scale = np.asarray(scipy.linalg.matrix_balance(through, permute=False, separate=True)[1][0])
    balanced = replace(
        blocks,
        A=blocks.A * scale[None, :] / scale[:, None],
        B=blocks.B / scale[:, None],
        Bw=blocks.Bw / scale[:, None],
        C=blocks.C * scale[None, :],
        Cv=blocks.Cv * scale[None, :],
    )
    return balanced, scale


def from_inputs(blocks: Blocks) -> Blocks:
    """Return the blocks without states that no input can move, by the pattern of zeros alone."""
    n = blocks.order
    acts = np.block([[blocks.A, blocks.Bw], [blocks.Cv, blocks.Dvw]]) != 0.0
    moved = np.concatenate([blocks.B.any(axis=1), blocks.Dv.any(axis=1)])
    while True:
        more = moved | acts[:, moved].any(axis=1)
        if (more == moved).all():
            break
        moved = more
    keep = np.flatnonzero(moved[:n])
    rest = blocks.matrices
    rest |= {"A": blocks.A[np.ix_(keep, keep)], "B": blocks.B[keep], "Bw": blocks.Bw[keep]}
    return Blocks(**rest | {"C": blocks.C[:, keep], "Cv": blocks.Cv[:, keep]})


def _picked(blocks: Blocks, keep: Any) -> Blocks:
    """Return the blocks with these channels alone."""
    matrices = blocks.matrices
    matrices |= {"Bw": blocks.Bw[:, keep], "Dw": blocks.Dw[:, keep], "Cv": blocks.Cv[keep]}
    matrices |= {"Dv": blocks.Dv[keep], "Dvw": blocks.Dvw[np.ix_(keep, keep)]}
    return Blocks(**matrices | {"delays": blocks.delays[keep]})


def _without_zero_delays(blocks: Blocks) -> Blocks:
    """Return the blocks with w = v where the delay is zero, that loop closed."""
    zero = np.flatnonzero(blocks.delays == 0.0)
    if not zero.size:
        return blocks
    rest = np.flatnonzero(blocks.delays > 0.0)
    m, p = blocks.inputs, blocks.outputs
    matrices = _picked(blocks, rest).matrices
    matrices |= {
        "B": np.hstack([blocks.B, blocks.Bw[:, zero]]),
        "C": np.vstack([blocks.C, blocks.Cv[zero]]),
        "D": np.block(
            [[blocks.D, blocks.Dw[:, zero]], [blocks.Dv[zero], blocks.Dvw[np.ix_(zero, zero)]]]
        ),
        "Dw": np.vstack([blocks.Dw[:, rest], blocks.Dvw[np.ix_(zero, rest)]]),
        "Dv": np.hstack([blocks.Dv[rest], blocks.Dvw[np.ix_(rest, zero)]]),
    }
    F = np.zeros((m + zero.size, p + zero.size))
    F[m:, p:] = np.eye(zero.size)
    closed = Blocks(**matrices).closed(F)
    return closed.between(np.eye(p, p + zero.size), np.eye(m + zero.size, m))


def _used(blocks: Blocks) -> Blocks:
    """Return the blocks without channels that nothing enters, or that lead nowhere."""
    into = blocks.Cv.any(axis=1) | blocks.Dv.any(axis=1) | blocks.Dvw.any(axis=1)
    out = blocks.Bw.any(axis=0) | blocks.Dw.any(axis=0) | blocks.Dvw.any(axis=0)
    keep = np.flatnonzero(into & out)
    return blocks if keep.size == blocks.delays.size else _picked(blocks, keep)


def _merged(blocks: Blocks) -> Blocks:
    """Return the blocks with channels of one signal and one delay added up."""
    rows = np.column_stack([blocks.delays, blocks.Cv, blocks.Dv, blocks.Dvw])
    first: dict[bytes, int] = {}
    owner = [first.setdefault((row + 0.0).tobytes(), i) for i, row in enumerate(rows)]
    keep = sorted(first.values())
    if len(keep) == len(owner):
        return blocks
    add = np.zeros((len(owner), len(owner)))
    add[np.arange(len(owner)), owner] = 1.0
    matrices = blocks.matrices
    matrices |= {name: getattr(blocks, name) @ add for name in ("Bw", "Dw", "Dvw")}
    return _picked(Blocks(**matrices), keep)


def _chained(blocks: Blocks) -> Blocks:
    """Return the blocks with v_j = c w_i, where nothing else uses w_i, as one delay."""
    for j in range(blocks.delays.size):
        sources = np.flatnonzero(blocks.Dvw[j])
        if sources.size != 1 or blocks.Cv[j].any() or blocks.Dv[j].any():
            continue
        i = int(sources[0])
        others = np.delete(blocks.Dvw[:, i], j)
        if i == j or others.any() or blocks.Bw[:, i].any() or blocks.Dw[:, i].any():
            continue
        matrices = {name: M.copy() for name, M in blocks.matrices.items()}
        c = blocks.Dvw[j, i]
        for name in ("Cv", "Dv", "Dvw"):
            matrices[name][j] = c * getattr(blocks, name)[i]
        matrices["delays"][j] = blocks.delays[i] + blocks.delays[j]
        return _chained(_used(Blocks(**matrices)))
    return blocks
