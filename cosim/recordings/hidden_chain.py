"""Losses that depend on the hidden state of a Markov chain: likelihood, fit, simulation.

The chain moves once per message, before it is sent, and each state loses messages with a
probability of its own. One state: independent losses. Two: Gilbert-Elliott.

The likelihood and its gradient are the forward and backward recursions (Rabiner, Proc. IEEE 77
(1989) 257), over all segments of a long recording at once: a segment is a product of matrices, and
what stands before it a row vector. With Fisher's identity the expected counts of transitions and
losses are the gradient by the logits, so that a quasi-Newton method finds the maximum that
Baum-Welch (expectation-maximisation) climbs to, in fewer steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.optimize
import scipy.special
from numpy.typing import NDArray

from cosim.network import draws
from cosim.recordings.identified import share_error

Floats = NDArray[np.float64]
Losses = NDArray[np.bool_]

_BOUND = 14.0
"""Greatest logit: a probability is between 1e-6 and 1 - 1e-6, or it is 0 or 1."""
_AT_BOUND = 11.0
_AT_ONCE = 4096
"""Messages of which all simulated draws are in memory."""
_STEP = 1e-4


@dataclass(frozen=True, eq=False)
class HiddenChain:
    """A chain of k states; state 0 loses the least.

    Attributes
    ----------
    transitions : from state (row) to state (column), per message, float64 (k, k); rows add to 1.
    loss : probability of a loss in each state, float64 (k,), never decreasing.
    """

    transitions: Floats
    loss: Floats

    @classmethod
    def sorted_by_loss(cls, transitions: Floats, loss: Floats) -> HiddenChain:
        """Return the chain with its states in order of loss."""
        order = np.argsort(loss, kind="stable")
        return cls(transitions[np.ix_(order, order)], loss[order])

    @cached_property
    def stationary(self) -> Floats:
        """The share of time in each state in the long run, float64 (k,)."""
        k = self.loss.size
        equations = np.vstack([self.transitions.T - np.eye(k), np.ones(k)])
        share = np.linalg.lstsq(equations, np.append(np.zeros(k), 1.0), rcond=None)[0]
        share = np.clip(share, 0.0, None)
        return np.asarray(share / share.sum())

    def log_likelihood(self, lost: Losses) -> float:
        """Return the logarithm of the probability of these losses; the chain is stationary.

        Minus infinity where the chain excludes them.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            found = _expected(self, lost, self.stationary).log_likelihood
        return -np.inf if np.isnan(found) else found  # 0 / 0: no way through a segment

    def simulate(self, count: int, copies: int, purpose: str) -> Losses:
        """Draw recordings of `count` messages, one in each column, bool (count, copies)."""
        lost = np.empty((count, copies), np.bool_)
        bounds = np.cumsum(self.transitions, axis=1)[:, :-1]
        state, begin = np.zeros(copies, np.intp), np.cumsum(self.stationary)[:-1]
        for first in range(0, count, _AT_ONCE):  # of a long recording not all draws are in memory
            rows = min(_AT_ONCE, count - first)
            part = rows * copies, 0, first * copies
            u, change = (
                draws.uniform(0, purpose, what, *part).reshape(rows, copies)
                for what in ("loss", "loss state")
            )
            for t in range(rows):
                if first + t == 0:
                    state = np.searchsorted(begin, change[0], side="right")
                elif begin.size:
                    state = (change[t][:, None] >= bounds[state]).sum(axis=1)
                lost[first + t] = u[t] < self.loss[state]
        return lost

    def log_likelihoods(self, lost: Losses) -> Floats:
        """Return `log_likelihood` of each column, float64 (copies,); none is excluded."""
        emitted = np.array([1.0 - self.loss, self.loss])
        row, total = np.tile(self.stationary, (lost.shape[1], 1)), np.zeros(lost.shape[1])
        for t, now in enumerate(lost.astype(np.int8)):
            row = (row @ self.transitions if t else row) * emitted[now]
            scale = row.sum(axis=1)
            total += np.log(scale)
            row /= scale[:, None]
        return total


class _Counts(NamedTuple):
    """Expected counts, and the logarithm of the likelihood.

    transitions : from state to state, float64 (k, k).
    messages, losses : in each state, float64 (k,).
    """

    log_likelihood: float
    transitions: Floats
    messages: Floats
    losses: Floats


def _expected(chain: HiddenChain, lost: Losses, first: Floats) -> _Counts:
    """Return what to expect of the hidden states, given the losses; `first` : shares at first."""
    n = lost.size
    each = np.where(lost[:, None], chain.loss, 1.0 - chain.loss)
    if chain.loss.size == 1:
        total = float(np.log(each).sum())
        losses = np.array([float(lost.sum())])
        return _Counts(total, np.array([[n - 1.0]]), np.array([float(n)]), losses)
    parts, step = _Segments.of(each), chain.transitions
    before, after = parts.ends(step, first)
    forward, log_likelihood = parts.forward(step, before)
    behind = parts.backward(step, after)
    states = forward * behind
    states /= states.sum(axis=2)[:, :, None]
    previous = np.concatenate([before[None], forward[:-1]])
    weight = parts.emitted * behind
    norm = np.einsum("tbi,ij,tbj->tb", previous, step, weight)
    use = parts.there.copy()
    use[0, 0] = False
    share = np.where(use, 1.0 / norm, 0.0)
    moves = np.einsum("tb,tbi,tbj->ij", share, previous, weight) * step
    states = states.transpose(1, 0, 2).reshape(-1, chain.loss.size)[:n]
    return _Counts(log_likelihood, moves, states.sum(axis=0), states[lost].sum(axis=0))


class _Segments(NamedTuple):
    """A recording in segments side by side: message t of segment b is the t + b length-th.

    Attributes
    ----------
    emitted : probability of what was seen in each state, float64 (length, segments, k).
    there : which are messages, not padding after the last, bool (length, segments).
    """

    emitted: Floats
    there: Losses

    @classmethod
    def of(cls, each: Floats) -> _Segments:
        """Cut the probabilities of what was seen, float64 (n, k), into segments."""
        n, k = each.shape
        length = max(1, int(np.sqrt(n) / 2))
        count = -(-n // length)
        padded = np.ones((count * length, k))
        padded[:n] = each
        there = n > np.arange(count * length).reshape(count, length).T
        by_time = padded.reshape(count, length, k).transpose(1, 0, 2)
        return cls(np.ascontiguousarray(by_time), there)

    def ends(self, step: Floats, first: Floats) -> tuple[Floats, Floats]:
        """Return the row vector before each segment, and the column vector after it."""
        count, k = self.emitted.shape[1:]
        # what a segment does to a row vector before it; message 0 has no transition before it
        ways = np.tile(np.eye(k), (count, 1, 1))
        for t, (emitted, there) in enumerate(zip(*self, strict=True)):
            moved = ways @ step
            if t == 0:
                moved[0] = ways[0]
            moved = moved * emitted[:, None, :]
            ways = np.where(there[:, None, None], moved, ways)
            ways /= ways.sum(axis=(1, 2))[:, None, None]
        before, after = np.empty((count, k)), np.empty((count, k))
        row, column = first, np.ones(k)
        for b in range(count):
            before[b] = row
            row = row @ ways[b]
            row = row / row.sum()
        for b in reversed(range(count)):
            after[b] = column
            column = ways[b] @ column
            column = column / column.sum()
        return before, after

    def forward(self, step: Floats, before: Floats) -> tuple[Floats, float]:
        """Return the shares of states given all up to each message, and the log-likelihood."""
        found, scale = np.empty(self.emitted.shape), np.ones(self.there.shape)
        row = before
        for t, (emitted, there) in enumerate(zip(*self, strict=True)):
            moved = row @ step
            if t == 0:
                moved[0] = row[0]
            moved = moved * emitted
            scale[t] = np.where(there, moved.sum(axis=1), 1.0)
            row = np.where(there[:, None], moved / scale[t][:, None], row)
            found[t] = row
        return found, float(np.log(scale).sum())

    def backward(self, step: Floats, after: Floats) -> Floats:
        """Return how probable all after each message is, up to a factor, from each state."""
        found, column = np.empty(self.emitted.shape), after
        for t in reversed(range(len(found))):
            found[t] = column
            moved = (self.emitted[t] * column) @ step.T
            moved /= moved.sum(axis=1)[:, None]
            column = np.where(self.there[t][:, None], moved, column)
        return found


class ChainFit(NamedTuple):
    """A chain of greatest likelihood.

    Attributes
    ----------
    chain : its parameters.
    log_likelihood : of the losses it was fitted to.
    loss_error, transitions_error : standard errors of its parameters, from the observed
        information; NaN where the model gives the value or it is at its bound, infinite where the
        data cannot tell it.
    """

    chain: HiddenChain
    log_likelihood: float
    loss_error: Floats
    transitions_error: Floats


def fit_chain(lost: Losses, states: int) -> ChainFit:
    """Fit a chain of so many states to losses by maximum likelihood, from several starts.

    At least one message must be lost and one not.
    """
    if states == 1:
        share = float(lost.mean())
        chain = HiddenChain(np.ones((1, 1)), np.array([share]))
        error = np.array([share_error(float(lost.sum()), lost.size)])
        return ChainFit(chain, chain.log_likelihood(lost), error, np.full((1, 1), np.nan))
    found = [_climb(start, lost) for start in _starts(lost, states)]
    best = min(found, key=lambda each: float(each.fun))
    chain = _chain_of(best.x, states)
    order = np.argsort(chain.loss, kind="stable")
    loss_error, moves_error = _errors(best.x, states, lost)
    return ChainFit(
        HiddenChain.sorted_by_loss(chain.transitions, chain.loss),
        chain.log_likelihood(lost),
        loss_error[order],
        moves_error[np.ix_(order, order)],
    )


def fit_gilbert(lost: Losses) -> ChainFit:
    """Fit the chain whose states are lost and not lost: shares of the transitions seen (Gilbert).

    Its runs have geometric lengths, and p_exit is one over the mean length of a run of losses.
    """
    moves = np.zeros((2, 2))
    np.add.at(moves, (lost[:-1].astype(int), lost[1:].astype(int)), 1.0)
    total = moves.sum(axis=1, keepdims=True)
    chain = HiddenChain(moves / np.maximum(total, 1.0), np.array([0.0, 1.0]))
    error = np.vectorize(share_error)(moves, total)
    return ChainFit(chain, chain.log_likelihood(lost), np.full(2, np.nan), error)


def _climb(start: Floats, lost: Losses) -> Any:
    k = _states_of(start.size)

    def value(x: Any) -> tuple[float, Any]:
        log_likelihood, gradient = _slope(x, k, lost)
        return -log_likelihood / lost.size, -gradient / lost.size

    bounds = [(-_BOUND, _BOUND)] * start.size
    options: Any = {"maxiter": 300, "ftol": 1e-13, "gtol": 1e-8}
    minimize: Any = scipy.optimize.minimize  # its types know no gradient beside the value
    return minimize(value, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)


def _slope(x: Floats, k: int, lost: Losses) -> tuple[float, Floats]:
    """Return the log-likelihood and its gradient by the logits."""
    chain = _chain_of(x, k)
    # the shares at first do not depend on the logits, or the counts would not be the gradient
    found = _expected(chain, lost, np.full(k, 1.0 / k))
    moves = found.transitions - found.transitions.sum(axis=1, keepdims=True) * chain.transitions
    off = ~np.eye(k, dtype=bool)
    return found.log_likelihood, np.append(moves[off], found.losses - found.messages * chain.loss)


def _parts(x: Floats, k: int) -> tuple[Floats, Floats]:
    """Return transitions and losses of logits: of each row but the diagonal, then of the losses."""
    logits = np.zeros((k, k))
    logits[~np.eye(k, dtype=bool)] = x[: k * (k - 1)]
    weights = np.exp(logits - logits.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True), scipy.special.expit(x[k * (k - 1) :])


def _chain_of(x: Floats, k: int) -> HiddenChain:
    return HiddenChain(*_parts(x, k))


def _states_of(parameters: int) -> int:
    return math.isqrt(parameters)


def _starts(lost: Losses, k: int) -> list[Floats]:
    """Return starts: states that last a little, and long, from seldom lost to often."""
    share = float(np.clip(lost.mean(), 0.02, 0.98))
    spread = np.log(share / (1.0 - share)) + np.linspace(-3.0, 3.0, k)
    starts = []
    for stay in (2.0, 4.5):
        moves = np.full((k, k), -stay)
        moves -= 0.3 * np.arange(k)[:, None]  # no two states alike
        starts.append(np.append(moves[~np.eye(k, dtype=bool)], spread))
    return starts


def _errors(x: Floats, k: int, lost: Losses) -> tuple[Floats, Floats]:
    """Return the standard errors of losses and transitions at the maximum."""
    free = np.flatnonzero(np.abs(x) < _AT_BOUND)
    unknown = np.full(k, np.nan), np.full((k, k), np.nan)
    if not free.size:
        return unknown
    curve = np.zeros((x.size, x.size))
    slopes = []
    for i in free:
        ahead, behind = x.copy(), x.copy()
        ahead[i] += _STEP
        behind[i] -= _STEP
        curve[:, i] = (_slope(ahead, k, lost)[1] - _slope(behind, k, lost)[1]) / (2 * _STEP)
        a, b = _parts(ahead, k), _parts(behind, k)
        slopes.append(np.append((a[0] - b[0]).ravel(), a[1] - b[1]) / (2 * _STEP))
    information = -(curve + curve.T)[np.ix_(free, free)] / 2.0
    values, vectors = np.linalg.eigh(information)
    by_direction = np.array(slopes).T @ vectors
    # some combinations of logits cannot be told from the data, nor what depends on them
    flat = values <= 1e-9 * max(values.max(), 1e-300)
    by_logit = by_direction[:, ~flat] / np.sqrt(values[~flat])
    error = np.sqrt((by_logit**2).sum(axis=1))
    error[error == 0.0] = np.nan
    error[(np.abs(by_direction[:, flat]) > 1e-6).any(axis=1)] = np.inf
    return error[k * k :], error[: k * k].reshape(k, k)
