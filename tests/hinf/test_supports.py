"""Conditions on the support of each delay: what they prove, their certificate, their solver."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from shared import sampled
from truth_of_ages import gain_over_patterns, period_radius
from truth_of_loops import abscissa, loop_of, norm

from cosim.core import InputError
from cosim.hinf import analyse, auv_system, check_certificate
from cosim.hinf.certificate import loop_to_json, standalone
from cosim.hinf.certificate.standalone import RefusedError
from cosim.hinf.lmi import Condition
from cosim.hinf.theorems import Support, supports_of
from cosim.models import Delay, DelaySystem

VEHICLE_GAIN = np.hstack([-0.06 * np.eye(4), -0.53 * np.eye(4)])


def axis_pair(*, link: bool = True, **age: Any) -> tuple[DelaySystem, Any]:
    """One axis (eta, nu), its observer's error e, and u = K (x - e), over a link of 0.2 s or not.

    The innovation of a position fix acts through the first delay, on e_1 alone.
    """
    A = np.kron(np.eye(2), [[0.0, 1.0], [0.0, -0.1]])
    fix = np.zeros((4, 4))
    fix[2:, 2] = -0.5, -0.06
    system = DelaySystem(
        A,
        [[0.0], [1.0], [0.0], [0.0]],
        C=[[0.0, 0.0], [1.0, 0.0], [0.0, -0.5], [1.0, -0.06]],
        D=[[0.1, 0, 0, 0], [0, 0, 0, 0]],
        D2=[[0.0], [1.0]],
        E=[[0.0], [0.05], [0.0], [0.05]],
        H=[[0.0, 0.2, 0.0, 0.0]],
        delays=[
            Delay(1.5, fix, **(age or {"any_age": True})),
            Delay(0.2 if link else 0.0, np.zeros((4, 4)), feedback=True, any_age=True),
        ],
    )
    return system, np.array([[-0.06, -0.53, 0.06, 0.53]])


def proved(system: DelaySystem, K: Any, order: int, own: list[Any], supports: Any) -> Any:
    """The solver's least gamma, and a certificate a little above it that both checkers accept."""
    lmi = Condition(system, K, order, own, performance=True, supports=supports)
    delays = [x.d for x in system.delays]
    least = lmi.least_gamma(delays, 2.0)
    assert least is not None
    found = lmi.margin(delays, 1.002 * least)
    assert found is not None
    exact = found[1].exactly(system, K)
    assert exact.failure(system, K) is None
    document = json.dumps(loop_to_json(system, K, exact))
    assert check_certificate(json.loads(document)).valid
    standalone.check(document.encode())
    return least, json.loads(document)


@pytest.mark.parametrize(
    ("age", "order", "functional"),
    [
        ({}, 1, "interval"),
        ({"any_age": True, "least_age": 0.4}, 1, "interval"),
        ({"rate": 0.3, "least_age": 0.1}, 0, "rate"),
        ({"sampled": True, "least_age": 0.4}, 0, "wirtinger"),
        ({"sampled": True, "least_age": 0.4}, 0, "looped"),
    ],
)
def test_on_the_states_next_to_nothing_is_lost(
    age: dict[str, Any], order: int, functional: str
) -> None:
    """Of every functional: gamma within 1 % of that of the whole state, never below it."""
    system, K = axis_pair(link=False, **age)
    own = [functional, "interval"]
    full = Condition(system, K, order, own, performance=True).least_gamma([1.5, 0.0], 2.0)
    assert full is not None
    assert supports_of(system, K) == (Support("states", (2,)),)
    made, document = proved(system, K, order, own, supports_of(system, K))
    assert document["variables"]["terms"][0]["states"] == [3]
    assert full * (1 - 1e-3) < made < 1.01 * full


def test_on_the_controls_little_is_lost() -> None:
    """One control instead of four states behind the link."""
    system, K = axis_pair()
    own, states = ["interval", "interval"], supports_of(system, K)
    controls = supports_of(system, K, controls=True)
    assert states == (Support("states", (2,)), None)
    assert controls == (Support("states", (2,)), Support("controls", (0,)))
    made, _ = proved(system, K, 0, own, states)
    fewer, document = proved(system, K, 0, own, controls)
    assert document["variables"]["terms"][1]["controls"] == [1]
    assert made * (1 - 1e-3) < fewer < 1.05 * made


def random_system(seed: int, **age: Any) -> DelaySystem:
    """Five states, all coupled, of which one or two act late; uncertain, w and z of two each."""
    rng = np.random.default_rng(seed)
    late = np.zeros((5, 5))
    late[:, rng.choice(5, 1 + seed % 2, replace=False)] = 0.5
    late *= rng.standard_normal((5, 5))
    A = rng.standard_normal((5, 5))
    while abscissa(loop_of(DelaySystem(A, delays=[Delay(0.6, late)]))) > -0.5:
        A = A - 0.2 * np.eye(5)
    return DelaySystem(
        A,
        C=rng.standard_normal((5, 2)),
        D=rng.standard_normal((2, 5)),
        E=0.3 * rng.standard_normal((5, 2)),
        H=0.3 * rng.standard_normal((2, 5)),
        delays=[Delay(0.6, late, 0.2 * np.sign(late[:2]), **age)],
    )


@pytest.mark.parametrize("seed", sampled(range(12), 1))
def test_no_gamma_is_below_what_a_loop_attains(seed: int) -> None:
    """Any age: neither a constant age with a constant F nor a sawtooth exceeds gamma."""
    system = random_system(seed, any_age=True)
    K = np.zeros((0, 5))
    _, document = proved(system, K, seed % 2, ["interval"], supports_of(system, K))
    gamma = document["claim"]["gamma"]
    top = float(Fraction(gamma)) if isinstance(gamma, str) else gamma
    rng, own = np.random.default_rng([seed, 1]), system.delays[0]
    for d in (0.05, 0.3, 0.6):
        for _ in range(2):
            F = rng.standard_normal((2, 2))
            F /= np.linalg.norm(F, 2)
            at = replace(system, delays=(Delay(d, own.A, own.H),))
            assert norm(loop_of(at, F=F)) <= top * (1 + 1e-6), (seed, d)
    for pattern in ([0.6], [0.1, 0.6]):
        assert period_radius(system.A, own.A, pattern) < 1
        for omega in (0.3, 2.0):
            reached = gain_over_patterns(
                system.A, own.A, system.C, system.D, pattern, omega, periods=12
            )
            assert reached <= top, (seed, pattern, omega)


def test_nothing_is_claimed_outside_the_support() -> None:
    """A state less, another state, a control that does not act: refused by both checkers."""
    system, K = axis_pair()
    own = ["interval", "interval"]
    _, document = proved(system, K, 0, own, supports_of(system, K, controls=True))
    for place, change in (
        (0, {"states": [2]}),
        (0, {"states": [5]}),
        (0, {"states": []}),
        (0, {"states": [3.5]}),
        (0, {"controls": [1]}),
        (0, {"states": [3], "controls": [1]}),
        (1, {"states": [1]}),
        (1, {"controls": [2]}),
        (1, {}),
    ):
        wrong = copy.deepcopy(document)
        term = wrong["variables"]["terms"][place]
        wrong["variables"]["terms"][place] = {k: term[k] for k in ("functional", "matrices")}
        wrong["variables"]["terms"][place] |= change
        with pytest.raises(InputError):
            check_certificate(wrong)
        with pytest.raises(RefusedError):
            standalone.check(json.dumps(wrong).encode())


def test_a_delay_that_acts_through_one_more_state_needs_it() -> None:
    """The same matrices do not prove a loop in which a further state acts late."""
    system, K = axis_pair()
    _, document = proved(system, K, 0, ["interval", "interval"], supports_of(system, K))
    document["system"]["delays"][0]["A"][2][0] = 1e-9
    with pytest.raises(InputError, match="outside its support"):
        check_certificate(document)
    with pytest.raises(RefusedError, match="outside its support"):
        standalone.check(json.dumps(document).encode())


def test_the_dense_solver_agrees_with_clarabel() -> None:
    """The least gamma of a vehicle, uncertainty included, and a system without any."""
    system = auv_system()
    own, supports = ["interval", "interval"], supports_of(system, VEHICLE_GAIN)
    known: Any = {"performance": True, "supports": supports}
    one, other = (
        Condition(system, VEHICLE_GAIN, 0, own, dense=dense, **known) for dense in (False, True)
    )
    delays = [x.d for x in system.delays]
    least = one.least_gamma(delays, 4.0)
    assert least is not None
    assert other.least_gamma(delays, 4.0) == pytest.approx(least, rel=1e-6)
    assert other.least_gamma([9.0, 9.0], 4.0) is None


def test_a_large_system_is_analysed_on_supports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the conditions about the whole state are too large; a small one keeps them."""
    system, K = axis_pair(link=False)
    assert "on the support" not in repr(analyse(system, K, order=0))
    monkeypatch.setattr("cosim.hinf.synthesis.conditions._LARGE", 20)
    found = analyse(system, K, order=0)
    assert found.certified, found.reason
    terms = found.certificate["variables"]["terms"]
    assert terms[0]["states"] == [3]
    assert found.gamma > found.exact_norm
    assert "on the support of each delay" in repr(found)
    assert "delay 1: states 3" in found._repr_html_()
