"""Fits find what made a recording, and refuse what did not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network import Jitter, LossChain, PacketLink, Recording, draws
from cosim.recordings import HiddenChain, LossModel, RangeDependence, fit_link

S = 10**9
BUOY = LossChain(((0.93, 0.07), (0.06, 0.94)), (0.06, 0.96))
"""Like buoys at sea: P(loss | loss) about 0.88, P(loss | ok) about 0.12."""
THREE = LossChain(((0.95, 0.04, 0.01), (0.1, 0.85, 0.05), (0.005, 0.005, 0.99)), (0.01, 0.5, 0.98))


def recording_of(count: int, seed: int = 0, **link: Any) -> Recording:
    """What a link of the project does to `count` messages, each 2 s."""
    up = PacketLink("up", 2 * S, seed=seed, order="as-arrived", **link)
    end = 2 * S * (count - 1)
    sent, delay = np.arange(0, end + 1, 2 * S), np.zeros(count, np.int64)
    lost = draws.lost(up.loss, up.seed, up.name, count)
    delay += up.delay_ns + draws.jitter_ns(up.jitter, up.seed, up.name, count)
    return Recording(sent, lost, delay)


def loss_models(first: NDArray[np.bool_], tested: NDArray[np.bool_]) -> list[LossModel]:
    """Independent, Gilbert's and Gilbert-Elliott's model, fitted to one part and tested on another.

    A fit takes the first two thirds of a recording, and holds them against the rest.
    """
    assert first.size == 2 * tested.size
    lost = np.concatenate([first, tested])
    return fit_link(Recording(np.arange(lost.size) * S, lost), most_states=2).losses


def models_of(count: int, seed: int = 0, **link: Any) -> tuple[NDArray[np.bool_], list[LossModel]]:
    """What a link of the project loses of `count` messages, and the models fitted to that."""
    lost = recording_of(count * 3 // 2, seed, **link).lost
    return lost[:count], loss_models(lost[:count], lost[count:])


def range_dependence(recording: Recording) -> list[RangeDependence]:
    """How the losses and delays of a recording depend on its range."""
    return fit_link(recording, most_states=2).ranges


def walked(chain: HiddenChain, lost: NDArray[np.bool_]) -> float:
    """The log-likelihood by the sum over all paths, message by message."""
    row, total = chain.stationary, 0.0
    for k, each in enumerate(lost):
        row = row @ chain.transitions if k else row
        row = row * (chain.loss if each else 1.0 - chain.loss)
        total += np.log(row.sum())
        row = row / row.sum()
    return total


@pytest.mark.parametrize("count", [1, 2, 3, 17, 100, 1001])
def test_the_likelihood_in_segments_is_that_of_a_walk(count: int) -> None:
    """However the segments fall; and so is that of what is simulated."""
    chain = HiddenChain(
        np.array([[0.9, 0.07, 0.03], [0.2, 0.7, 0.1], [0.0, 0.05, 0.95]]),
        np.array([0.02, 0.5, 0.9]),
    )
    lost = chain.simulate(count, 2, "test")
    likelihood = chain.log_likelihoods(lost)
    for j in range(2):
        exact = walked(chain, lost[:, j])
        assert chain.log_likelihood(lost[:, j]) == pytest.approx(exact, abs=1e-9)
        assert likelihood[j] == pytest.approx(exact, abs=1e-9)


def test_geometric_runs_have_a_closed_form() -> None:
    """Gilbert: shares of transitions; p_exit is one over the mean run; the climb finds no more."""
    made = LossChain(((0.9, 0.1), (0.25, 0.75)), (0.0, 1.0))
    lost, (independent, fit, found) = models_of(3000, loss=made)
    pairs = list(zip(lost[:-1].tolist(), lost[1:].tolist(), strict=True))
    enter = pairs.count((False, True)) / (pairs.count((False, True)) + pairs.count((False, False)))
    leave = pairs.count((True, False)) / (pairs.count((True, False)) + pairs.count((True, True)))
    assert fit.chain.transitions[0, 1] == pytest.approx(enter, rel=1e-12)
    assert fit.chain.transitions[1, 0] == pytest.approx(leave, rel=1e-12)
    runs = np.diff(np.flatnonzero(np.diff(lost.astype(int), prepend=0, append=0)))[::2]
    assert leave == pytest.approx(1.0 / runs.mean(), rel=0.01)
    # two more parameters: the likelihood grows by chance, 7 with probability 1e-3
    assert -0.05 < (found.log_likelihood - fit.log_likelihood) * lost.size < 7.0
    assert found.chain.transitions[1, 0] == pytest.approx(leave, abs=0.05)
    assert independent.chain.loss[0] == lost.mean()


def test_no_parameter_nearby_is_more_likely() -> None:
    """The maximum is one: a step in any direction makes the losses less likely."""
    lost, (*_, fit) = models_of(1500, loss=BUOY)
    best, random = walked(fit.chain, lost), np.random.default_rng(1)
    for _ in range(30):
        moves = fit.chain.transitions + 0.01 * random.standard_normal((2, 2))
        moves = np.clip(moves, 1e-6, 1.0)
        loss = np.clip(fit.chain.loss + 0.01 * random.standard_normal(2), 1e-6, 1 - 1e-6)
        other = HiddenChain(moves / moves.sum(axis=1, keepdims=True), loss)
        assert walked(other, lost) < best + 0.05


def test_parameters_are_recovered_within_their_errors() -> None:
    """Of six recordings, each parameter within two standard errors in nearly all."""
    within = []
    for seed in range(6):
        _, (*_, fit) = models_of(3000, seed, loss=BUOY)
        for got, error, made in (
            (fit.chain.transitions[0, 1], fit.transitions_error[0, 1], 0.07),
            (fit.chain.transitions[1, 0], fit.transitions_error[1, 0], 0.06),
            (fit.chain.loss[0], fit.loss_error[0], 0.06),
            (fit.chain.loss[1], fit.loss_error[1], 0.96),
        ):
            within.append(abs(got - made) < 1.96 * error)
            assert error < 0.03
    # 24 intervals of 95 %: fewer than 19 has probability 1e-3
    assert sum(within) >= 19


def test_a_link_of_the_schema_is_found_and_not_refused() -> None:
    """Delay, jitter and losses of a buoy; wrong models are refused, by the runs above all."""
    jitter = Jitter("exponential", mean_ns=60_000_000)
    made = recording_of(3000, loss=BUOY, delay_ns=310_000_000, jitter=jitter)
    found = fit_link(made, most_states=2)
    assert found.refusals == []
    assert found.loss.name == "gilbert-elliott"
    assert found.delay is not None
    assert found.delay.name == "exponential"
    assert found.delay.delay == pytest.approx(0.31, abs=0.001)
    assert found.delay.mean == pytest.approx(0.06, rel=0.1)
    independent, gilbert = found.losses[:2]
    assert {"runs of losses", "runs of arrivals"} <= set(independent.refused_by)
    assert "runs of losses it was fitted to" in gilbert.refused_by
    assert {each.name for each in found.delays if each.refused_by} == {"uniform", "normal"}
    assert found.losses[2].tested > max(independent.tested, gilbert.tested)


def test_three_kinds_of_loss_need_three_states() -> None:
    """The chain of three explains more than Gilbert-Elliott, also of what it has not seen."""
    found = fit_link(recording_of(4500, seed=1, loss=THREE))
    assert found.loss.name == "chain of 3"
    assert found.refusals == []
    assert found.losses[2].bic > found.loss.bic + 10.0
    assert found.losses[2].tested < found.loss.tested
    made = found.loss.chain.transitions
    assert np.allclose(made, THREE.transitions, atol=0.05)
    assert np.allclose(found.loss.chain.loss, THREE.loss, atol=0.1)


@pytest.mark.parametrize(("later", "refused"), [(0.115, False), (0.18, True)])
def test_a_share_may_differ_by_chance_and_no_more(later: float, refused: bool) -> None:  # noqa: FBT001
    """Of 1000 and 500 messages: one standard error is .0164, both parts counted."""
    random = np.random.default_rng(0)
    one, two = random.permutation(1000) < 100, random.permutation(500) < 500 * later
    model = loss_models(one, two)[0]
    assert ("share of losses" in model.refused_by) == refused


def test_a_model_that_excludes_what_happened_is_refused() -> None:
    """Gilbert saw a loss end each run and no longer one: then two in a row are impossible."""
    single, double = np.arange(400) % 9 == 4, np.arange(200) % 9 < 2
    models = loss_models(single, double)
    assert models[1].tested == -np.inf
    assert "likelihood" in models[1].refused_by


def test_what_no_model_makes_is_refused_by_name() -> None:
    """A link that changes for good, losses like a clock, delays that follow each other."""
    change = np.concatenate([np.zeros(800, bool), np.tile([True, False], 200)])
    sent, none = np.arange(1200) * S, np.zeros(1200, np.int64)
    found = fit_link(Recording(sent, change, none), 2)
    assert "share of losses" in " ".join(found.refusals)
    clock = np.arange(1200) % 7 == 3
    found = fit_link(Recording(sent, clock, none), 2)
    assert "runs of arrivals" in " ".join(found.refusals)
    slow = (5e8 + 2e8 * np.sin(np.arange(1200) / 40)).astype(np.int64)
    found = fit_link(Recording(sent, np.zeros(1200, bool), slow))
    assert "correlation of each delay with the next" in " ".join(found.refusals)


@pytest.mark.slow
def test_the_right_model_is_seldom_refused() -> None:
    """Over sixty recordings of a buoy: at a level of 1 %, more than three have probability 1e-3."""
    refused = 0
    for seed in range(60):
        _, models = models_of(1000, 100 + seed, loss=BUOY)
        refused += bool(models[2].refused_by)
    assert refused <= 3


@pytest.mark.parametrize(
    ("jitter", "name"),
    [
        (Jitter("uniform", width_ns=400_000_000), "uniform"),
        (Jitter("exponential", mean_ns=100_000_000), "exponential"),
        (Jitter("normal", mean_ns=300_000_000, sigma_ns=60_000_000), "normal"),
        (Jitter("normal", sigma_ns=100_000_000), "normal"),
        (Jitter(), "constant"),
    ],
)
def test_each_kind_of_jitter_is_found(jitter: Jitter, name: str) -> None:
    """The likeliest kind is the one that made the delays, and nothing refuses it."""
    models = fit_link(recording_of(3000, 1, jitter=jitter, delay_ns=200_000_000)).delays
    best = max(models, key=lambda each: each.log_likelihood)
    assert best.name == name
    assert best.refused_by == []
    assert all(each.refused_by for each in models if each is not best)


def test_loss_over_range_is_logistic() -> None:
    """Made with logit p = -4 + r / 250 m, and sound at 1480 m/s with 0.2 s before it."""
    random = np.random.default_rng(3)
    r = 200.0 + 1500.0 * random.random(4000)
    lost = random.random(4000) < 1.0 / (1.0 + np.exp(4.0 - r / 250.0))
    delay = np.rint((0.2 + r / 1480.0) * 1e9).astype(np.int64)
    found = range_dependence(Recording(np.arange(4000) * S, lost, delay, range_m=r))[0]
    assert abs(found.slope - 1 / 250) < 3 * found.slope_error
    assert found.slope_error < 3e-4
    assert found.intercept == pytest.approx(-4.0, abs=0.5)
    assert found.p_value < 1e-6
    assert found.speed == pytest.approx(1480.0, rel=1e-4)
    assert found.offset_s == pytest.approx(0.2, abs=1e-3)
    chance = range_dependence(Recording(np.arange(4000) * S, random.random(4000) < 0.3, range_m=r))
    assert chance[0].p_value > 0.01
    split = Recording(np.arange(4000) * S, r > 900.0, range_m=r)
    assert range_dependence(split) == []


def test_too_little_is_refused() -> None:
    """Too few messages, too many states; nothing lost, or no times, is no reason to refuse."""
    with pytest.raises(InputError, match="at least 60"):
        fit_link(recording_of(59))
    with pytest.raises(InputError, match="2 to 5"):
        fit_link(recording_of(60), most_states=6)
    quiet = fit_link(recording_of(60))
    assert (quiet.loss.name, quiet.table()["loss"], quiet.refusals) == ("independent", 0.0, [])
    all_lost = fit_link(Recording(np.arange(90) * S, np.ones(90, bool)))
    assert all_lost.table() == {"kind": "packet", "sample_time": 1.0, "loss": 1.0}


def test_a_parameter_that_cannot_be_identified_has_no_number() -> None:
    """States of independent losses, p_exit of one run: no number with a meaningless error."""
    lost = np.random.default_rng(1).random(450) < 0.3
    two_states = loss_models(lost[:300], lost[300:])[2]
    assert two_states.unidentified == ["p_enter", "p_exit", "loss_good", "loss_bad"]
    assert all(each.low is None for each in two_states.probabilities)
    once = np.arange(300) == 150
    independent, gilbert, _ = loss_models(once, np.zeros(150, bool))
    assert gilbert.unidentified == ["p_exit"]
    (share,) = independent.probabilities
    # Clopper and Pearson's interval of 1 of 300 is [8e-5, .0184]
    assert share.low is not None
    assert share.high is not None
    assert 8e-5 < share.low < 1 / 300 < 0.0184 < share.high < 0.03
    clear = fit_link(recording_of(3000, loss=BUOY), most_states=2)
    assert clear.gaps == []
    assert {each.name for each in clear.loss.probabilities} == {
        "p_enter",
        "p_exit",
        "loss_good",
        "loss_bad",
    }
    assert all(0.0 < each.high - each.low < 0.2 for each in clear.loss.probabilities if each.high)


@pytest.mark.slow
def test_intervals_of_a_share_cover_the_truth() -> None:
    """95 % intervals of a share of few losses, told in nearly all of 60 recordings."""
    random, none = np.random.default_rng(5), np.zeros(100, bool)
    fits = [loss_models(random.random(200) < 0.04, none)[0] for _ in range(60)]
    shares = [share for fit in fits for share in fit.probabilities]
    known = [each for each in shares if each.low is not None and each.high is not None]
    assert len(known) == 60
    inside = sum(each.low < 0.04 < each.high for each in known)
    # fewer than 51 of 60 have a probability of 1e-3 at .95
    assert inside >= 51


def test_a_delay_that_grows_with_the_range_by_chance_has_no_speed() -> None:
    """Of twenty recordings without any dependence none says one of sound."""
    random = np.random.default_rng(2)
    speeds = []
    for _ in range(20):
        r = 200.0 + 1500.0 * random.random(200)
        delay = np.rint((0.2 + 0.05 * random.random(200)) * 1e9).astype(np.int64)
        lost = random.random(200) < 0.2
        lost[: 200 * 2 // 3] = False  # without losses there is no model to fit to this part
        speeds += [
            each.speed
            for each in range_dependence(Recording(np.arange(200) * S, lost, delay, range_m=r))
        ]
    assert len(speeds) == 20
    assert speeds.count(None) >= 19
