"""Mean-square stability of a loop whose messages are lost in a Markov chain with hidden states.

Two tests, of different things; neither is the share of time in touch, which is about one run:

* `rates_mean_square`: from the proved rates alpha and beta. A period T with its message is in
  touch, one without it at worst out of touch: E V obeys v_{k+1} <= diag(m) P' v_k by states, m_i =
  (1 - l_i) e^{-2 alpha T} + l_i e^{2 beta T}. A spectral radius below 1 is sufficient, with all the
  uncertainty of the proof. (Gilbert: diag(e^{-2 alpha T}, e^{2 beta T}) P'.)
* `jump_mean_square`: the nominal loop as a Markov jump linear system (Costa, Fragoso, Marques,
  Discrete-Time Markov Jump Linear Systems, 2005; Seiler, Sengupta, IEEE TAC 50 (2005) 356): fixed
  period, play-out, no uncertainty. Necessary and sufficient for this chain; where it is stable a
  Lyapunov function is shown in ball arithmetic, e^{Ah} enclosed.

Both assume that the chain is the truth: its states move once per message, messages are lost
independently given the states, and nothing else delays them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import flint
import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.hinf.certificate import outage_delay
from cosim.hinf.exact import ball_precision, exact, exact_matrix, first_bad_pivot

if TYPE_CHECKING:
    from cosim.hinf.certificate import Outages
    from cosim.models import DelaySystem

_BITS = 200


@dataclass(frozen=True)
class MeanSquare:
    """The outcome of a test of mean-square stability.

    Attributes
    ----------
    radius : the spectral radius of the second moments, per period (computed).
    stable : whether it is below 1; where `proved`, that is shown.
    proved : by a Lyapunov function in ball arithmetic (`jump_mean_square` alone).
    assumptions : what it is about, in words.
    """

    radius: float
    stable: bool
    proved: bool
    assumptions: tuple[str, ...]


_CHAIN = (
    "the losses are those of the chain: its state moves once per message, messages are lost "
    "independently given the states"
)
_TIMELY = (
    "a message each {:g} s; while one is in use the feedback is at most as old as designed for, "
    "otherwise the proved fallback acts: age of a message when it comes into use + period <= d"
)
_LIFTED = "exactly one message each {:g} s, used {:g} s after it was sent, for one period; lost: {}"


def rates_mean_square(
    outages: Outages, transitions: ArrayLike, loss: ArrayLike, period: float
) -> MeanSquare:
    """Test E V -> 0 from proved rates: sufficient, with the uncertainty of the proof.

    Parameters
    ----------
    transitions : (k, k) from state (row) to state (column) of the chain, per message.
    loss : (k,) probability of a loss in each state.
    period : time between messages [s].

    Raises
    ------
    InputError : not a chain.
    """
    moves, lost = _chain(transitions, loss, period)
    touch, out = (
        math.exp(-2 * float(outages.alpha) * period),
        math.exp(2 * max(float(outages.beta), -float(outages.alpha)) * period),
    )
    growth = (1 - lost) * touch + lost * out
    radius = _radius(moves.T * growth)
    return MeanSquare(
        radius,
        radius < 1,
        proved=False,
        assumptions=(
            _CHAIN,
            _TIMELY.format(period),
            "sufficient only; every plant of the uncertainty; w = 0",
        ),
    )


def jump_mean_square(
    system: DelaySystem,
    gain: ArrayLike,
    transitions: ArrayLike,
    loss: ArrayLike,
    period: float,
    playout: float,
    *,
    lost: Literal["zero", "hold"] = "zero",
) -> MeanSquare:
    """Test E |x|^2 -> 0 of the nominal loop as a Markov jump linear system.

    Parameters
    ----------
    system : Eq. (7), whose only delay is that of the feedback.
    gain : (m, n) K: u = K x(k period) from k period + playout on, for a period, unless lost.
    transitions, loss : of the chain, as of `rates_mean_square`.
    period, playout : [s]; playout may exceed the period.
    lost : what acts in place of a lost message.

    Raises
    ------
    InputError : not a chain, or a plant with delays of its own.
    """
    moves, chance = _chain(transitions, loss, period)
    outage_delay(system)
    if len(system.delays) > 1 or not 0 <= playout < 100 * period:
        raise InputError(
            "the lifted test is of a plant without delays of its own",
            where="system, playout",
            expected="one delay, that of the feedback, and 0 <= playout < 100 periods",
            got=f"{len(system.delays)} delays, playout {playout:g} s",
        )
    with ball_precision(_BITS):
        modes = _lifted(system, np.asarray(gain, np.float64), period, playout, hold=lost == "hold")
        floats = [_floats(mode) for mode in modes]
        k, n = chance.size, len(floats[0])
        squares = [np.kron(A, A) for A in floats]
        # second moments by state j after a step: sum_i P_ij ((1 - l_i) A0 Q_i A0' + l_i A1 Q_i A1')
        transfer = np.block(
            [
                [
                    moves[i, j] * ((1 - chance[i]) * squares[0] + chance[i] * squares[1])
                    for i in range(k)
                ]
                for j in range(k)
            ]
        )
        radius = _radius(transfer)
        proved = radius < 1 and _has_lyapunov_function(modes, moves, chance, transfer, n)
    return MeanSquare(
        radius,
        radius < 1,
        proved=proved,
        assumptions=(
            _CHAIN,
            _LIFTED.format(
                period, playout, "u = 0" if lost == "zero" else "the last command is held"
            ),
            "the nominal plant, no uncertainty; w = 0; the mean over the chain, not one run",
        ),
    )


def _chain(
    transitions: ArrayLike, loss: ArrayLike, period: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    moves, lost = np.asarray(transitions, np.float64), np.asarray(loss, np.float64)
    fits = moves.shape == (lost.size, lost.size) and lost.ndim == 1 and lost.size > 0
    if not (
        fits
        and ((moves >= 0) & (moves <= 1)).all()
        and ((lost >= 0) & (lost <= 1)).all()
        and np.allclose(moves.sum(axis=1), 1.0, atol=1e-9)
    ):
        raise InputError(
            "not a chain",
            where="transitions, loss",
            expected="a row of probabilities per state that add to 1, and one loss per state",
            got=f"shapes {moves.shape} and {lost.shape}",
        )
    if not (math.isfinite(period) and period > 0):
        raise InputError("not a period", where="period", expected="a positive number of s")
    return moves, lost


def _radius(matrix: NDArray[np.float64]) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


def _lifted(
    system: DelaySystem, gain: NDArray[np.float64], period: float, playout: float, *, hold: bool
) -> tuple[Any, Any]:
    """Return the step of (x, u_{k-1}, .., u_{k-m-1}) with message k, and without it, in balls."""
    n, m = system.B.shape
    T, playout_s = exact(period), exact(playout)
    back = int((playout_s / T).floor())
    rest = playout_s - back * T
    # held over the first `rest` of the period: u_{k-back-1}; then u_{k-back}
    first, second = (_constant_input(system, flint.fmpq(h)) for h in (rest, T - rest))
    past = m * (back + 1)

    def select(j: int) -> Any:
        """Return u_{k-j} of the vector, j >= 1."""
        entries = [[int(c == n + (j - 1) * m + i) for c in range(n + past)] for i in range(m)]
        return flint.arb_mat(entries)

    x = flint.arb_mat([[int(i == j) for j in range(n + past)] for i in range(n)])
    with_message = flint.arb_mat(exact_matrix(gain)) * x
    without = select(1) if hold else 0 * select(1)
    steps = []
    for u in (with_message, without):
        old, new = select(back + 1), u if back == 0 else select(back)
        middle = first[0] * x + first[1] * old
        rows = [second[0] * middle + second[1] * new, u, *(select(j) for j in range(1, back + 1))]
        table = [
            [each[i, j] for j in range(n + past)] for each in rows for i in range(each.nrows())
        ]
        steps.append(flint.arb_mat(table))
    return steps[0], steps[1]


def _constant_input(system: DelaySystem, h: Any) -> tuple[Any, Any]:
    """Enclose e^{A h} and the integral of e^{A s} B over [0, h]."""
    n, m = system.B.shape
    A, B = exact_matrix(system.A), exact_matrix(system.B)
    augmented = [[A[i, j] for j in range(n)] + [B[i, j] for j in range(m)] for i in range(n)]
    augmented += [[flint.fmpq(0)] * (n + m) for _ in range(m)]
    made = (flint.arb_mat([[flint.arb(x * h) for x in row] for row in augmented])).exp()
    return (
        flint.arb_mat([[made[i, j] for j in range(n)] for i in range(n)]),
        flint.arb_mat([[made[i, n + j] for j in range(m)] for i in range(n)]),
    )


def _floats(matrix: Any) -> NDArray[np.float64]:
    return np.array([[float(matrix[i, j].mid()) for j in range(matrix.ncols())]
                     for i in range(matrix.nrows())])  # fmt: skip


def _has_lyapunov_function(
    modes: tuple[Any, Any],
    moves: NDArray[np.float64],
    chance: NDArray[np.float64],
    transfer: NDArray[np.float64],
    n: int,
) -> bool:
    """Show S_i > 0 with S_i - sum_j P_ij ((1 - l_i) A0'S_j A0 + l_i A1'S_j A1) > 0, in balls."""
    k = chance.size
    right = np.tile(np.eye(n).ravel(), k)
    # the adjoint of the step of the second moments
    S = scipy.linalg.solve(np.eye(transfer.shape[0]) - transfer.T, right).reshape(k, n, n)
    S = (S + S.transpose(0, 2, 1)) / 2
    balls = [flint.arb_mat(exact_matrix(one)) for one in S]
    for i in range(k):
        after = sum((flint.arb(exact(moves[i, j])) * balls[j] for j in range(k)), 0 * balls[0])
        change = flint.arb_mat(balls[i])
        share = flint.arb(exact(chance[i]))
        for weight, A in ((1 - share, modes[0]), (share, modes[1])):
            change = change - weight * (A.transpose() * after * A)
        for one in (balls[i], change):
            lower = [[one[a, b] for b in range(a + 1)] for a in range(n)]
            if first_bad_pivot(lower) is not None:
                return False
    return True
