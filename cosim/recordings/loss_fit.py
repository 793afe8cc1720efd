"""Models of losses, fitted to one part of a recording and tested on the other.

A model is refused where what it would lose differs from what was lost: the share, the lengths of
runs, or the likelihood as a whole. How far a difference may go by chance is simulated, and what the
parameters do not know for lack of data is added to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from cosim.recordings.hidden_chain import ChainFit, Floats, HiddenChain, fit_chain, fit_gilbert
from cosim.recordings.identified import Parameter, parameter
from cosim.recordings.statistics import runs_of

Losses = NDArray[np.bool_]

LEVEL = 0.01
"""Probability with which a recording made by a model is refused for it, over all statistics."""
COPIES = 200
_ONE_STATE_LESS = 0.05
"""Probability that a chain seems to need its last state by chance, so that no state is told."""
_BINS = np.array([1, 2, 3, 5, 9, 17, 33, 65, 129, 257, 513, 1025])
"""Least lengths of the classes in which runs are counted."""
_STATISTICS = (
    *("likelihood", "share of losses", "runs of losses", "runs of arrivals"),
    *("runs of losses it was fitted to", "runs of arrivals it was fitted to"),
)


@dataclass(frozen=True)
class LossModel:
    """A model of losses and how it fits.

    Attributes
    ----------
    name : "none", "independent", "gilbert", "gilbert-elliott" or "chain of k".
    chain : its parameters; one state where losses are independent.
    loss_error, transitions_error : standard errors; NaN where the model gives the value or it is
        at its bound, infinite where the data do not tell it.
    parameters : how many were fitted.
    log_likelihood, tested : natural logarithm per message, of the part it was fitted to and of
        the other; minus infinity where a model excludes what happened.
    bic : Bayesian information criterion on the first part; less is better.
    p_values : of each statistic of the other part, and of the runs of the part it was fitted to:
        how probable a difference as large is, if the model is right.
    """

    name: str
    chain: HiddenChain
    loss_error: Floats
    transitions_error: Floats
    parameters: int
    log_likelihood: float
    tested: float
    bic: float
    p_values: dict[str, float]

    @property
    def probabilities(self) -> list[Parameter]:
        """The parameters, each with its interval or without one; stays of a chain of three on."""
        chain, states = self.chain, self.chain.loss.size
        moves, errors = chain.transitions, self.transitions_error
        if states == 1:
            return [parameter("loss", float(chain.loss[0]), float(self.loss_error[0]))]
        if states == 2:
            found = [
                parameter("p_enter", float(moves[0, 1]), float(errors[0, 1])),
                parameter("p_exit", float(moves[1, 0]), float(errors[1, 0])),
            ]
            names = ["loss_good", "loss_bad"]
        else:
            found = [
                parameter(f"stay {k}", float(moves[k, k]), float(errors[k, k]))
                for k in range(states)
            ]
            names = [f"loss {k}" for k in range(states)]
        lost = zip(names, chain.loss.tolist(), self.loss_error.tolist(), strict=True)
        return found + [parameter(*each) for each in lost]

    @property
    def unidentified(self) -> list[str]:
        """Names of the parameters that the data do not tell."""
        return [each.name for each in self.probabilities if not each.identified]

    @property
    def refused_by(self) -> list[str]:
        """The statistics that refuse the model, the clearest first."""
        least = LEVEL / len(_STATISTICS)
        refusing = [name for name, p in self.p_values.items() if p < least]
        return sorted(refusing, key=lambda name: self.p_values[name])


def loss_models(first: Losses, tested: Losses, most_states: int) -> list[LossModel]:
    """Fit every model to the first part and hold it against the other, in order of complexity."""
    if not first.any() or first.all():
        return [_judged("independent", fit_chain(first, 1), 1, first, tested)]
    found = [
        _judged("independent", fit_chain(first, 1), 1, first, tested),
        _judged("gilbert", fit_gilbert(first), 2, first, tested),
    ]
    fewer, parameters = found[0].log_likelihood * first.size, 1
    for states in range(2, most_states + 1):
        name = "gilbert-elliott" if states == 2 else f"chain of {states}"
        fit = fit_chain(first, states)
        gain = 2.0 * (fit.log_likelihood - fewer)
        if gain < scipy.stats.chi2.isf(_ONE_STATE_LESS, states**2 - parameters):
            fit = fit._replace(
                loss_error=np.full(states, np.inf),
                transitions_error=np.full((states, states), np.inf),
            )
        found.append(_judged(name, fit, states**2, first, tested))
        fewer, parameters = fit.log_likelihood, states**2
    return found


def _judged(name: str, fit: ChainFit, parameters: int, first: Losses, tested: Losses) -> LossModel:
    other = fit.chain.log_likelihood(tested)
    return LossModel(
        name,
        fit.chain,
        fit.loss_error,
        fit.transitions_error,
        parameters,
        fit.log_likelihood / first.size,
        other / tested.size,
        parameters * float(np.log(first.size)) - 2.0 * fit.log_likelihood,
        _p_values(fit.chain, other, first, tested),
    )


def _p_values(chain: HiddenChain, own: float, first: Losses, tested: Losses) -> dict[str, float]:
    simulated = chain.simulate(tested.size, COPIES, "goodness")
    likelihoods = chain.log_likelihoods(simulated)
    # the parameters were estimated from a recording of this length, which has a chance of its own
    spread = 1.0 + tested.size / first.size
    shares = simulated.mean(axis=0)
    found = {
        _STATISTICS[0]: _two_sided(own, likelihoods, spread),
        _STATISTICS[1]: _two_sided(float(tested.mean()), shares, spread),
    }
    again = chain.simulate(first.size, COPIES, "goodness of the first part")
    parts = ((tested, simulated, spread), (first, again, 1.0))
    names = iter(_STATISTICS[2:])
    for losses, copies, wider in parts:
        for value in (True, False):
            expected = np.array([_classes(copies[:, j], value=value) for j in range(COPIES)])
            found[next(names)] = _distance(_classes(losses, value=value), expected, wider)
    return found


def _two_sided(seen: float, expected: Floats, spread: float) -> float:
    deviation = float(expected.std(ddof=1)) * np.sqrt(spread)
    off = abs(seen - float(expected.mean()))
    if not np.isfinite(off):  # the model excludes what happened
        return 0.0
    # where the model is certain, any difference refuses it; rounding is none
    if deviation <= 1e-12 * max(1.0, abs(seen)):
        return 1.0 if off <= 1e-9 * max(1.0, abs(seen)) else 0.0
    return float(2.0 * scipy.stats.norm.sf(off / deviation))


def _classes(lost: Losses, *, value: bool) -> Floats:
    first, length = runs_of(lost)
    mine = length[lost[first] == value]
    classes = np.searchsorted(_BINS, mine, side="right") - 1
    return np.bincount(classes, minlength=_BINS.size).astype(np.float64)


def _distance(seen: Floats, expected: Floats, spread: float) -> float:
    """Return how probable it is that counts are as far from their mean as those that were seen.

    The squares of the differences over the variances, added; their own distribution is that of a
    multiple of chi-squared with the mean and variance simulated (Satterthwaite).
    """
    mean, variance = expected.mean(axis=0), expected.var(axis=0, ddof=1)
    # a class in which next to nothing is expected varies by at least that
    variance = np.maximum(variance, np.maximum(mean, 1.0 / expected.shape[0]))
    squares = ((expected - mean) ** 2 / variance).sum(axis=1)
    own = float(((seen - mean) ** 2 / variance).sum()) / spread
    middle, wide = float(squares.mean()), float(squares.var(ddof=1))
    if wide <= 0.0:
        return 1.0 if own <= middle else 0.0
    return float(scipy.stats.chi2.sf(2.0 * own * middle / wide, 2.0 * middle**2 / wide))
