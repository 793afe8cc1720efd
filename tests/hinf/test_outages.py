"""The proof with outages: published rates, both checkers, and no claim that a run beats."""

from __future__ import annotations

import json
from copy import deepcopy
from dataclasses import replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from cosim import hinf
from cosim.core import InputError, NotAchievableError
from cosim.hinf.certificate import guarantees_from_json, standalone
from cosim.models import Delay, DelaySystem

NCS_GAIN = [[-3.75, -11.5]]
AXIS_GAIN = [[-0.06, -0.53]]


def link(d: float) -> tuple[Delay, ...]:
    """Feedback of any age up to d."""
    return (Delay(d, np.zeros((2, 2)), feedback=True, any_age=True),)


def ncs(d: float, **more: Any) -> DelaySystem:
    """The loop of networked control's textbooks (Zhang, Branicky, Phillips 2001)."""
    return DelaySystem(A=[[0, 1], [0, -0.1]], B=[[0], [0.1]], delays=link(d), **more)


def axis(d: float) -> DelaySystem:
    """One axis of the vehicle with its damping on board, as an acceleration."""
    return DelaySystem(A=[[0, 1], [0, -0.05]], B=[[0], [1]], delays=link(d))


@pytest.mark.parametrize(
    ("system", "gain", "alpha", "beta", "share"),
    [
        (ncs(0.5), NCS_GAIN, 0.3, 0.233, 0.437),
        (axis(1.25), AXIS_GAIN, 0.1, 0.062, 0.38),
        (axis(2.0), AXIS_GAIN, 0.04, 0.121, 0.75),
    ],
)
def test_rates_are_those_that_another_solver_found(
    system: DelaySystem, gain: Any, alpha: float, beta: float, share: float
) -> None:
    """Found with cvxpy and Clarabel by others, to the digits given."""
    found = hinf.synthesis.certified_outages(system, gain, alpha=alpha)
    assert float(found.alpha) == pytest.approx(alpha, rel=1e-12)
    assert float(found.beta) == pytest.approx(beta, rel=8e-3)
    assert float(found.share) == pytest.approx(share, abs=5e-3)
    assert found.failure(system, np.array(gain)) is None


def test_a_search_finds_a_share_at_most_that_at_a_given_alpha() -> None:
    found = hinf.synthesis.certified_outages(ncs(0.5), NCS_GAIN)
    assert float(found.share) < 0.4375


def test_a_gain_that_bears_no_such_age_has_no_rates() -> None:
    with pytest.raises(NotAchievableError, match=r"any age up to 2\.65 s"):
        hinf.synthesis.certified_outages(axis(2.65), AXIS_GAIN)


@pytest.mark.parametrize(
    ("system", "got"),
    [
        (DelaySystem(A=[[-1.0]], B=[[1.0]], delays=[Delay(0.5, [[0.1]])]), "no control acts"),
        (
            DelaySystem(A=[[-1.0]], B=[[1.0]], delays=[Delay(0.5, [[0.1]], feedback=True)]),
            "the plant itself",
        ),
        (
            DelaySystem(
                A=-np.eye(2),
                B=np.eye(2),
                delays=[Delay(0.5, np.zeros((2, 2)), feedback=(True, False))],
            ),
            "different ages",
        ),
    ],
)
def test_a_loop_without_one_link_is_refused_with_the_reason(system: DelaySystem, got: str) -> None:
    n, m = system.B.shape
    with pytest.raises(InputError, match=got):
        hinf.synthesis.certified_outages(system, np.diag(np.r_[-0.1, np.zeros(n - 1)])[:m])


UNCERTAIN = {"C": [[0], [1]], "D": [[1, 0], [0, 0]], "D2": [[0], [0.1]]} | {
    "E": [[0], [0.02]],
    "H": [[1, 1]],
}
ON_BOARD = {"fallback": [[-0.5, -2.0]], "fallback_age": 0.2}


@cache
def proved(fallback: str) -> Any:
    """An analysis with uncertainty and a gain that is proved across outages as well."""
    found = hinf.analyse(ncs(0.5, **UNCERTAIN), NCS_GAIN)
    return hinf.synthesis.with_outages(
        found, alpha=0.1, **(ON_BOARD if fallback == "on board" else {})
    )


@pytest.mark.parametrize("fallback", ["zero", "on board"])
def test_both_checkers_prove_the_file(fallback: str) -> None:
    found = proved(fallback)
    data = json.loads(json.dumps(found.certificate))
    assert hinf.check_certificate(data).valid
    claim = standalone.check(json.dumps(data).encode())["guarantees"]["outages"]
    assert claim == standalone.loaded(json.dumps(data["claim"]).encode())["guarantees"]["outages"]
    assert any("2 beta T_out" in sentence for sentence in data["theorem"])


def _below(text: str, factor: str) -> str:
    return str(Fraction(text) * Fraction(factor))


CHANGES: dict[str, Any] = {
    "a growth that is too slow": lambda t: t.update(beta=_below(t["beta"], "49/50")),
    "a decay that is too fast": lambda t: t.update(alpha=_below(t["alpha"], "4/3")),
    "a gamma that is too small": lambda t: t.update(gamma=_below(t["gamma"], "1/2")),
    "kernels above the exponential": lambda t: t.update(rho=[_below(t["rho"][0], "51/50")]),
    "another S": lambda t: t["S"][0][0].__setitem__(0, _below(t["S"][0][0][0], "1000")),
    "another multiplier out of touch": lambda t: t.update(eps_out=_below(t["eps_out"], "1/4")),
    "an M too great": lambda t: t["M"][0][0].__setitem__(0, _below(t["R"][0][0][0], "2")),
    "another fallback": lambda t: t.update(fallback=[[2.0, 2.0]]),
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("fallback", ["zero", "on board"])
def test_what_is_changed_is_refused_by_both_checkers(fallback: str, change: str) -> None:
    data = deepcopy(json.loads(json.dumps(proved(fallback).certificate)))
    table = data["guarantees"]["outages"]
    CHANGES[change](table)
    system = hinf.certificate.system_from_json(data["system"])
    changed = guarantees_from_json(data, system, np.array(data["K"])).outages
    assert changed is not None
    data["claim"]["guarantees"]["outages"] = changed.claim()
    data["theorem"] = hinf.certificate.theorem_of(data["claim"])
    assert changed.failure(system, np.array(data["K"])) is not None
    assert not hinf.check_certificate(data).valid
    with pytest.raises(standalone.RefusedError, match=r"not positive|rho|bounds"):
        standalone.check(json.dumps(data).encode())


class Flight:
    """A loop flown exactly: u is constant over each step, and x from the matrix exponential."""

    step = 0.01

    def __init__(self, system: DelaySystem, gain: Any, found: Any, delta: float) -> None:
        self.K, self.back = np.array(gain), found.fallback
        self.A = system.A + delta * system.E @ system.H
        self.B, self.C, self.d = system.B, system.C, system.delays[0].d
        n = len(self.A)
        inputs = np.hstack([self.B, self.C])
        whole = np.zeros((n + inputs.shape[1],) * 2)
        whole[:n, :n], whole[:n, n:] = self.A, inputs
        self.moved = scipy.linalg.expm(whole * self.step)[:n]
        self.found = found

    def fly(self, rng: np.random.Generator, seconds: float, x0: Any, w: float) -> Any:
        """Return x at the points, both one-sided x', whether in touch, and w, step by step."""
        count, most = round(seconds / self.step), round(self.d / self.step)
        back_age = round(self.found.fallback_age / self.step)
        x, rates, touch, noise = [np.array(x0, float)], [], [], []
        stamp, quiet = 0, 0
        for k in range(count):
            if quiet == 0 and rng.random() < 0.01:
                quiet = int(rng.integers(20, 400))
            quiet = max(quiet - 1, 0)
            if quiet == 0 and rng.random() < 0.1:
                stamp = max(stamp, k - int(rng.integers(0, most // 2)), 0)
            there = k + 1 - stamp <= most
            age = max(k - int(rng.integers(0, back_age)), 0) if back_age else k
            # what acts at once is, over a step, the mean of its ends: here that of the beginning
            u = self.K @ x[stamp] if there else self.back @ x[age]
            now = w * rng.standard_normal(self.C.shape[1]) if self.C.size else np.zeros(0)
            inputs = np.concatenate([u, now])
            x.append(self.moved @ np.concatenate([x[-1], inputs]))
            drive = self.B @ u + (self.C @ now if self.C.size else 0.0)
            rates.append((self.A @ x[k] + drive, self.A @ x[k + 1] + drive))
            touch.append(there)
            noise.append(now)
        return np.array(x), np.array(rates), np.array(touch), np.array(noise)

    def functional(self, x: Any, rates: Any, every: int) -> Any:
        """Return V at every so many points; the history before 0 is constant."""
        alpha, h, most = float(self.found.alpha), self.step, round(self.d / self.step)
        P, S, R = (
            np.array([[float(m[i, j].p) / float(m[i, j].q) for j in range(2)] for i in range(2)])
            for m in (self.found.unknowns[name] for name in ("P", "S[0]", "R[0]"))
        )
        past = np.concatenate([np.tile(x[:1], (most, 1)), x])
        before = np.zeros((most, 2, 2))
        moved = np.concatenate([before, rates])
        own = np.einsum("ti,ij,tj->t", past, S, past)
        fast = np.einsum("tsi,ij,tsj->ts", moved, R, moved)
        age = np.arange(most + 1)[::-1] * h
        kernel = np.exp(-2 * alpha * age)
        inner = kernel * (self.d - age)  # d int int: x'(s) counts from theta = s - t on
        values = []
        for k in range(0, len(x), every):
            window = own[k : k + most + 1] * kernel
            V = x[k] @ P @ x[k] + h * (window.sum() - (window[0] + window[-1]) / 2)
            ends = fast[k : k + most]
            V += self.d * h / 2 * (ends[:, 0] * inner[:-1] + ends[:, 1] * inner[1:]).sum()
            values.append(V)
        return np.array(values)


@pytest.mark.parametrize("fallback", ["zero", "on board"])
@pytest.mark.parametrize("seed", range(4))
def test_no_run_exceeds_the_bound_on_V(fallback: str, seed: int) -> None:
    """Random outages, ages and uncertainty, on the exact integrator; from x0 and constant past."""
    found = proved(fallback).guarantees.outages
    rng = np.random.default_rng(seed)
    flight = Flight(ncs(0.5, **UNCERTAIN), NCS_GAIN, found, delta=rng.choice([-1.0, 0.3, 1.0]))
    x, rates, touch, _ = flight.fly(rng, 40.0, rng.standard_normal(2), 0.0)
    V = flight.functional(x, rates, 20)
    rise = np.where(touch, -2 * float(found.alpha), 2 * float(found.beta)) * flight.step
    exponent = np.concatenate([[0.0], np.cumsum(rise)])[::20]
    # of any earlier V, not only the first; what is left is the trapezoidal rule
    highest = np.log(V) - exponent
    assert touch.mean() < 0.95
    assert (~touch).mean() < 0.95
    assert (
        np.maximum.accumulate(highest[::-1])[::-1] <= np.minimum.accumulate(highest) + 5e-3
    ).all()


@pytest.mark.parametrize("seed", range(3))
def test_no_run_exceeds_the_weighted_gain(seed: int) -> None:
    found, system = proved("zero").guarantees.outages, ncs(0.5, **UNCERTAIN)
    rng = np.random.default_rng(100 + seed)
    flight = Flight(system, NCS_GAIN, found, delta=1.0)
    x, _, touch, w = flight.fly(rng, 60.0, [0.0, 0.0], 1.0)
    rise = np.where(touch, -2 * float(found.alpha), 2 * float(found.beta)) * flight.step
    weight = np.exp(-np.cumsum(rise))
    out = (weight * (x[1:] @ system.D.T)[:, 0] ** 2).sum()
    assert out <= (float(found.gamma) ** 2) * (weight * (w**2).sum(axis=1)).sum()


def test_the_bound_over_a_recording_is_that_of_its_definition() -> None:
    rates = hinf.synthesis.certified_outages(axis(1.25), AXIS_GAIN, alpha=0.1)
    a, b = float(rates.alpha), float(rates.beta)
    rng = np.random.default_rng(1)
    t = np.concatenate([[0.0], np.cumsum(rng.exponential(3.0, 60))])
    touch = rng.random(60) < 0.6
    found = hinf.delay_lti.outage_bound(rates, t, touch)
    slope = np.where(touch, -2 * a, 2 * b)
    fine = np.linspace(0, t[-1], 20_001)
    at = slope[np.searchsorted(t, fine[:-1], side="right") - 1]
    g = np.concatenate([[0.0], np.cumsum(at * np.diff(fine))])
    deficit = g - np.minimum.accumulate(g)
    assert found.exponent == pytest.approx(g[-1], abs=1e-2)
    assert found.greatest_exponent == pytest.approx(deficit.max(), abs=1e-2)
    assert found.guaranteed_share == pytest.approx((deficit <= 1e-9).mean(), abs=2e-3)
    assert found.share_had == pytest.approx(np.diff(t)[touch].sum() / t[-1])
    lasting = sum((end or t[-1]) - begin for begin, end in found.suspensions_s)
    assert lasting / t[-1] == pytest.approx(1 - found.guaranteed_share)


def test_without_an_outage_the_gain_is_the_plain_one_and_nothing_is_suspended() -> None:
    rates = hinf.synthesis.certified_outages(axis(1.25), AXIS_GAIN, alpha=0.1)
    found = hinf.delay_lti.outage_bound(rates, [0.0, 5.0, 9.0], [True, True])
    assert found.gain_factor == pytest.approx(1.0)
    assert (found.suspensions_s, found.guaranteed_share, found.decays) == ((), 1.0, True)


def test_an_outage_that_is_never_made_up_is_open_at_the_end() -> None:
    rates = hinf.synthesis.certified_outages(axis(1.25), AXIS_GAIN, alpha=0.1)
    found = hinf.delay_lti.outage_bound(rates, [0.0, 5.0, 90.0, 91.0], [True, False, True])
    assert found.suspensions_s == ((5.0, None),)
    assert not found.decays
    assert found.share_had < found.share_needed


@pytest.mark.parametrize(
    ("after_loss", "after_arrival", "zero", "greater"),
    [(0.87, 0.09, 0.917, 1.26), (0.90, 0.17, 0.953, 1.34)],
)
def test_zero_and_hold_differ_in_mean_square(
    after_loss: float, after_arrival: float, zero: float, greater: float
) -> None:
    """The vehicle's axis, pings each 2 s used .65 s later, losses as three buoys had them."""
    chain = [[1 - after_arrival, after_arrival], [1 - after_loss, after_loss]], [0.0, 1.0]
    found = hinf.delay_lti.jump_mean_square(axis(1.25), AXIS_GAIN, *chain, 2.0, 0.65)
    assert found.radius == pytest.approx(zero, abs=6e-4)
    assert found.proved
    hold = hinf.delay_lti.jump_mean_square(axis(1.25), AXIS_GAIN, *chain, 2.0, 0.65, lost="hold")
    assert hold.radius == pytest.approx(greater, abs=6e-3)
    assert (hold.stable, hold.proved) == (False, False)


@pytest.mark.parametrize("playout", [0.0, 0.65, 2.0, 3.1])
def test_the_lifted_loop_moves_second_moments_as_simulated_ones_move(playout: float) -> None:
    """Exactly, by the tree of all sequences of losses over six messages."""
    chance, moves = np.array([0.1, 0.7]), np.array([[0.8, 0.2], [0.3, 0.7]])
    found = hinf.delay_lti.jump_mean_square(axis(1.25), AXIS_GAIN, moves, chance, 2.0, playout)
    none = hinf.delay_lti.jump_mean_square(axis(1.25), AXIS_GAIN, [[1.0]], [1.0], 2.0, playout)
    # with every message lost the loop is open, with its integrator
    assert none.radius == pytest.approx(1.0, abs=1e-7)
    sure = hinf.delay_lti.jump_mean_square(axis(1.25), AXIS_GAIN, [[1.0]], [0.0], 2.0, playout)
    A, B = axis(1.25).A, axis(1.25).B
    size = 3 + int(playout // 2.0)
    step = np.zeros((size, size))
    for i in range(size):  # a period with the message, by an integration of its own
        x, past = np.eye(size)[i][:2], np.eye(size)[i][2:]
        u = float((np.array(AXIS_GAIN) @ x)[0])
        queue = [u, *past]
        back = int(playout // 2.0)
        for h, acting in ((playout % 2.0, queue[back + 1]), (2.0 - playout % 2.0, queue[back])):
            whole = scipy.linalg.expm(np.block([[A, B], [np.zeros((1, 3))]]) * h)
            x = whole[:2, :2] @ x + whole[:2, 2] * acting
        step[:, i] = np.concatenate([x, queue[: size - 2]])
    assert sure.radius == pytest.approx(np.abs(np.linalg.eigvals(step)).max() ** 2, rel=1e-9)
    assert found.radius > 0


def test_the_sufficient_condition_is_that_of_gilbert_and_never_the_share() -> None:
    rates = hinf.synthesis.certified_outages(axis(1.25), AXIS_GAIN, alpha=0.1)
    a, b, T = float(rates.alpha), float(rates.beta), 2.0
    P = np.array([[0.91, 0.09], [0.13, 0.87]])
    found = hinf.delay_lti.rates_mean_square(rates, P, [0.0, 1.0], T)
    whole = np.diag([np.exp(-2 * a * T), np.exp(2 * b * T)]) @ P.T
    assert found.radius == pytest.approx(np.abs(np.linalg.eigvals(whole)).max())
    # the share of one run suffices, 59 % of the time in touch, and yet the mean square grows:
    share = 0.13 / 0.22
    assert share > float(rates.share)
    assert not found.stable
    assert 0.87 * np.exp(2 * b * T) > 1
    assert any("uncertainty" in words for words in found.assumptions)


def test_what_is_no_chain_is_refused() -> None:
    with pytest.raises(InputError, match="not a chain"):
        hinf.delay_lti.jump_mean_square(
            axis(1.0), AXIS_GAIN, [[0.5, 0.4], [0.1, 0.9]], [0, 1], 2.0, 0.0
        )


def test_a_loop_without_a_gain_proves_nothing_across_outages() -> None:
    """Its analysis is certified, and u = 0 is no gain that a link could carry."""
    alone = hinf.analyse(replace(ncs(0.5), A=-np.eye(2)))
    assert alone.certified
    with pytest.raises(InputError, match="there is no certified gain"):
        hinf.synthesis.with_outages(alone)
