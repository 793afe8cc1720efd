"""Plant and observer as one `DelaySystem`: the pair, whose analysis proves an output feedback.

An observer keeps an estimate xh of x, from measurements y_i = C_i x + v_i that are tau_i old and
carry their stamps, and the control acts on it, at once or by the age tau_c of the command:

    xh'(t) = sum_j A_j xh(t-d_j) + B u_acted(t) + sum_i L_i (y_i - C_i xh)(t-tau_i)
    u_acted(t) = K xh(t-tau_c)

The innovation compares with the estimate stored at the stamp, and is held between messages; the
observer knows u as it acted (after limits, thrust map and play-out), and the plant's own delays;
one whose age varies it takes to be its greatest, d_j: e' has A_j (x(t-tau_j) - xh(t-d_j)).
With e = x - xh, v_i = N_i w_i, N_i the diagonal of the noise,

    x' = sum_j (A_j + dA_j) x(t-d_j) + B K (x - e)(t-tau_c) + C w
    e' = sum_j A_j e(t-d_j) + sum_j dA_j x(t-d_j) + C w - sum_i L_i (C_i e(t-tau_i) + N_i w_i)
    z  = D x + D1 w + D2 K (x - e)(t-tau_c)

which is Eq. (7) in (x, e) with the "control" u' = (u, C_1 e, ..., C_p e), fed back by

    K' = [K -K; 0 C_1; ...; 0 C_p],  B' = [B 0 .. 0; 0 -L_1 .. -L_p],  D2' = [D2 0 .. 0],
    A_j' = diag(A_j, A_j),  C' = [C 0 ..; C -L_1 N_1 ..],  E' = [E; E],  H_j' = [H_j 0],

the rows of K' at the ages of command and measurements (`DelaySystem.feedback` by entry). Every
entry is one of the plant's, of K, L_i or C_i, so that the proof of the pair, in rationals, is about
these doubles; L_i N_i is exact since the noise is rounded up until it is (`exact_noise`).

**States that are known.** Where a state depends on u and on states of its kind alone (the lag of a
thruster, driven by what acts), without disturbance and uncertainty, the observer's copy equals it:
such states have no e, and no row in L_i.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.models import Delay, DelaySystem, Matrix, Measurement, Value

_BITS = 53  # of a double


@dataclass(frozen=True, eq=False)
class ObserverPair(Value):
    """The pair of a plant and its observer, and what it was made of.

    Attributes
    ----------
    system : the pair: Eq. (7) in (x, e), with the disturbances w and w_1 .. w_p.
    gain : K' (m + k, n + n_e), k values measured in all, n_e states estimated.
    plant : Eq. (7), n states, m controls.
    measurements : with the noise that the pair has: rounded up by `exact_noise`.
    K : (m, n).
    L : (n, k_i) of each measurement; rows of zeros for states that are known.
    command_age : greatest age [s] of the command.
    command_any_age : whether that age varies up to it; otherwise it is constant (play-out).
    estimated : (n,) whether each state is estimated; the others are known.
    """

    system: DelaySystem
    gain: Matrix
    plant: DelaySystem
    measurements: tuple[Measurement, ...]
    K: Matrix
    L: tuple[Matrix, ...]
    command_age: float
    command_any_age: bool
    estimated: NDArray[np.bool_]


def pair_of(
    system: DelaySystem,
    measurements: Sequence[Measurement],
    K: ArrayLike,
    L: Sequence[ArrayLike],
    *,
    command_age: float = 0.0,
    command_any_age: bool = False,
    estimated: Sequence[bool] | None = None,
) -> ObserverPair:
    """Return the pair of a plant and an observer, for `analyse(pair.system, pair.gain)`.

    Parameters
    ----------
    system : the plant (n states, m controls), without feedback of its own.
    measurements : at least one.
    K : (m, n) u = K xh.
    L : (n, k_i) one injection per measurement.
    command_age : age [s] at which u acts; 0: at once.
    command_any_age : any age up to it, in place of the constant one of a play-out.
    estimated : one truth value per state, False where the state is known; None: all are estimated.

    Raises
    ------
    InputError : names the measurement or argument, what was expected and what was got.
    """
    n, m = system.B.shape
    _check_plant(system)
    checked_measurements(system, measurements)
    chosen = _estimated(system, estimated)
    gain = _matrix("K", K, (m, n))
    if len(L) != len(measurements):
        raise InputError(
            "not one injection per measurement",
            where="L",
            expected=f"{len(measurements)} matrices",
            got=str(len(L)),
        )
    injections, exact_measurements = [], []
    for measurement, injection in zip(measurements, L, strict=True):
        rows = _matrix(f"L of {measurement.name}", injection, (n, len(measurement.C)))
        if rows[~chosen].any():
            state = int(np.flatnonzero(rows.any(axis=1) & ~chosen)[0])
            raise InputError(
                "a state that is known is corrected by a measurement",
                where=f"L of {measurement.name}[{state + 1}]",
                expected="a row of zeros",
                got=str(rows[state].tolist()),
            )
        injections.append(rows)
        exact_measurements.append(replace(measurement, noise=exact_noise(rows, measurement.noise)))
    if not (math.isfinite(command_age) and command_age >= 0):
        raise InputError(
            "not an age", where="command_age", expected="seconds >= 0", got=repr(command_age)
        )
    parts = (gain, tuple(injections), chosen, float(command_age), bool(command_any_age))
    pair, K_ = _assembled(system, exact_measurements, *parts)
    return ObserverPair(
        *(pair, K_, system, tuple(exact_measurements), gain, tuple(injections)),
        *(float(command_age), bool(command_any_age), chosen),
    )


def _assembled(
    system: DelaySystem,
    measurements: Sequence[Measurement],
    K: Matrix,
    L: Sequence[Matrix],
    chosen: NDArray[np.bool_],
    command_age: float,
    command_any_age: bool,  # noqa: FBT001
) -> tuple[DelaySystem, Matrix]:
    """Return the system of the pair and K'."""
    (n, m), p = system.B.shape, len(system.D)
    k, n_e = sum(len(x.C) for x in measurements), int(chosen.sum())
    values, N = m + k, n + n_e

    def wide(matrix: Matrix, columns: int = n_e) -> Matrix:
        return np.hstack([matrix, np.zeros((len(matrix), columns))])

    noisy = [
        -L_i[chosen][:, on] * np.array(x.noise)[on]
        for L_i, x in zip(L, measurements, strict=True)
        for on in [np.array(x.noise) > 0]
    ]
    noise = np.hstack(noisy) + 0.0  # no negative zero
    C = np.block([[system.C, np.zeros((n, noise.shape[1]))], [system.C[chosen], noise]])
    B = np.zeros((N, values))
    B[:n, :m] = system.B
    B[n:, m:] = -np.hstack([L_i[chosen] for L_i in L]) + 0.0
    gain = np.zeros((values, N))
    gain[:m, :n], gain[:m, n:] = K, -K[:, chosen] + 0.0

    def acting(rows: slice) -> list[list[bool]]:
        mask = np.zeros((values, N), dtype=bool)
        mask[rows, 0 if rows.start < m else n :] = True
        return mask.tolist()  # type: ignore[no-any-return]

    delays = [term for x in system.delays for term in _of_both(x, chosen)]
    at_once, is_delayed = acting(slice(0, m)), command_age > 0
    if is_delayed:
        zero = np.zeros((N, N))
        delays.append(Delay(command_age, zero, None, at_once, command_any_age))
    first = m
    for x in measurements:
        rows = slice(first, first + len(x.C))
        gain[rows, n:] = x.C[:, chosen]
        delays.append(x.delay(N, acting(rows)))
        first = rows.stop
    pair = DelaySystem(
        A=_diagonal(system.A, system.A[np.ix_(chosen, chosen)]),
        B=B,
        C=C if C.size else None,
        D=wide(system.D) if p else None,
        D1=wide(system.D1, noise.shape[1]) if p and C.size else None,
        D2=wide(system.D2, k) if p else None,
        E=np.vstack([system.E, system.E[chosen]]) if system.E.size else None,
        H=wide(system.H) if system.H.size else None,
        delays=delays,
        name=system.name,
        feedback=None if is_delayed else at_once,
        uncertainty_blocks=system.uncertainty_blocks,
    )
    return pair, gain


def _of_both(delay: Delay, chosen: NDArray[np.bool_]) -> Iterator[Delay]:
    """Yield a delay of the plant as one of the pair; two where the observer takes it to be d."""
    (n, n_e), A = (len(chosen), int(chosen.sum())), delay.A
    error = A[np.ix_(chosen, chosen)]
    H = np.hstack([delay.H, np.zeros((len(delay.H), n_e))])
    if not (delay.any_age and A.any()):
        yield replace(delay, A=_diagonal(A, error), H=H)
        return
    nothing = np.zeros((n, n_e))
    yield replace(delay, A=np.block([[A, nothing], [A[chosen], nothing[chosen]]]), H=H)
    assumed = np.block([[np.zeros((n, n)), nothing], [-A[chosen] + 0.0, error]])
    yield Delay(delay.d, assumed)


def exact_noise(injection: Matrix, noise: Sequence[float]) -> tuple[float, ...]:
    """Return the least noise, at least the given one, whose products with L are exact doubles.

    injection : (n, k). An L of few digits costs nothing; one of 53 bits costs a factor of two at
    most.
    """
    matrices = []
    for column, size in zip(injection.T, noise, strict=True):
        bits = max((_odd_bits(x) for x in column.tolist()), default=0)
        mantissa, exponent = math.frexp(size)
        kept = max(_BITS - bits, 1)
        matrices.append(math.ldexp(math.ceil(math.ldexp(mantissa, kept)), exponent - kept))
    return tuple(matrices)


def _odd_bits(x: float) -> int:
    """Return how many bits the odd part of a double has."""
    top = abs(Fraction(x).numerator)
    return (top >> ((top & -top).bit_length() - 1)).bit_length() if top else 0


def checked_measurements(system: DelaySystem, measurements: Sequence[Measurement]) -> None:
    """Refuse measurements that do not fit the plant, and none at all.

    Raises
    ------
    InputError : naming the measurement.
    """
    if not measurements:
        raise InputError("nothing is measured", where="measurements", expected="at least one")
    n, names = len(system.A), [x.name for x in measurements]
    for x in measurements:
        if names.count(x.name) > 1:
            raise InputError(
                "two measurements have one name", where="measurements", got=repr(x.name)
            )
        if x.C.shape[1] != n:
            raise InputError(
                "a measurement does not fit the system",
                where=f"measurement {x.name}: C",
                expected=f"{n} columns, one per state",
                got=str(x.C.shape[1]),
            )


def _check_plant(system: DelaySystem) -> None:
    """Refuse a plant that says how it is fed back, or whose delays no observer knows."""
    where = f"{system.name}: feedback" if system.name else "feedback"
    if not system.B.size:
        raise InputError("the system has no control", where=where, expected="B", got="no B")
    if system.feedback is not None or not system.immediate_feedback:
        raise InputError(
            "an observer feeds back its estimate of every state",
            where=where,
            expected="no feedback in the system: ages belong to measurements, and to the command",
            got="feedback",
        )
    if system.integrals:
        raise InputError(
            "an observer estimates states of the plant, not integrals of the controller",
            where=f"{system.name}: integral" if system.name else "integral",
            expected="no integral action",
        )


def _estimated(system: DelaySystem, estimated: Sequence[bool] | None) -> NDArray[np.bool_]:
    """Return which states have an error, checked: the others must be known."""
    n = len(system.A)
    chosen = np.ones(n, dtype=bool) if estimated is None else np.array(estimated)
    if chosen.shape != (n,) or chosen.dtype != np.bool_ or not chosen.any():
        raise InputError(
            "not which states are estimated",
            where="estimated",
            expected=f"{n} truth values, at least one of them true",
            got=str(estimated),
        )
    known = ~chosen
    matrices = {"A": system.A} | {f"A{j}": x.A for j, x in enumerate(system.delays, 1)}
    acting = {name: M[np.ix_(known, chosen)] for name, M in matrices.items()}
    acting |= {"C": system.C[known], "E": system.E[known]}
    acting |= {f"A{j}": x.A[known] for j, x in enumerate(system.delays, 1) if x.any_age}
    for name, entries in acting.items():
        if entries.any():
            state = int(np.flatnonzero(known)[np.flatnonzero(entries.any(axis=1))[0]])
            raise InputError(
                "this state is not known: not only u and states that are known act on it",
                where=f"estimated: state {state + 1}",
                expected=f"true, or a row of zeros in {name}",
                got="false",
            )
    return chosen


def _matrix(name: str, value: ArrayLike, shape: tuple[int, int]) -> Matrix:
    matrix = np.array(value, dtype=np.float64)
    if matrix.shape != shape or not np.isfinite(matrix).all():
        raise InputError(
            "wrong shape" if matrix.shape != shape else "not finite",
            where=name,
            expected=f"{shape[0]} rows of {shape[1]} finite numbers",
            got=str(matrix.shape),
        )
    return matrix


def _diagonal(first: Matrix, second: Matrix) -> Matrix:
    """Return the block-diagonal matrix of two."""
    (a, b), (c, d) = first.shape, second.shape
    return np.block([[first, np.zeros((a, d))], [np.zeros((c, b)), second]])
