"""Observer and gain designed together: what is certified of them, and what they beat."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.core import InputError, NotAchievableError
from cosim.hinf import (
    Delay,
    DelaySystem,
    Result,
    analyse,
    auv_system,
    check_certificate,
    design_output_feedback,
    hinf_norm,
)
from cosim.hinf.certificate import pair_of, standalone
from cosim.hinf.certificate.standalone import RefusedError
from cosim.hinf.delay_lti import close
from cosim.hinf.lmi import InjectionLmi, units_of, without_performance
from cosim.hinf.synthesis import PairGain
from cosim.models import Measurement

AXIS = DelaySystem(
    [[0, 1], [0, 0]], [[0], [1]], [[0], [1]], [[0.1, 0.0], [0.0, 0.0]], D2=[[0], [1]], name="axis"
)
SLOW = DelaySystem([[-0.1]], [[1]], [[1]], [[1], [0]], D2=[[0], [1]], name="slow")
DEPTH = Measurement("depth", [[1]], 0.5, noise=[0.1])
FIXES = Measurement("position", [[1, 0]], 1.5, any_age=True)


def onboard() -> DelaySystem:
    """The vehicle with its onboard damping, half a second late; the loop closes on board."""
    system = auv_system()
    own = [replace(x, feedback=False, any_age=False) for x in system.delays if x.A.any()]
    return replace(system, delays=tuple(own))


def test_the_axis_of_the_theory_bears_fixes_of_any_age_of_a_second_and_a_half() -> None:
    """MATH 7: L = (.53, .057); the LMI of the error finds one, up to 8 s with small ones."""
    units = units_of(AXIS)[0]
    for d, most in ((1.5, 1.0), (8.0, 0.2)):
        late = replace(FIXES, d=d)
        lmi = InjectionLmi(AXIS, [late], np.ones(2, dtype=bool), units.state, units.T)
        found = lmi.least_gamma(d)
        assert found is not None
        assert np.abs(found[1][0]).max() < most
        pair = pair_of(AXIS, [late], [[-0.06, -0.53]], found[1])
        assert analyse(without_performance(pair.system), pair.gain, order=0).certified


def test_derivatives_of_the_pairs_gain_are_those_of_differences() -> None:
    """By K and by L, with noise, uncertainty and a late command."""
    plant = DelaySystem(
        *(np.array([[0, 1], [0, -0.5]]), [[0], [1]], [[0], [1]], np.diag([0.1, 0.0])),
        D2=[[0], [1]],
        E=[[0.0], [0.2]],
        H=[[0.0, 0.5]],
        delays=[Delay(0.4, np.diag([0, -0.1]))],
    )
    sensors = [replace(FIXES, noise=(0.2,)), Measurement("speed", [[0, 1]], 0.2, noise=[0.1])]
    known: dict[str, Any] = {"command_age": 0.1}
    loop = PairGain(plant, sensors, known)
    alone = PairGain(plant, sensors, known, only_uncertain=True)
    L = [np.array([[0.5], [0.1]]), np.array([[0.1], [0.4]])]
    theta = loop.theta(np.array([[-0.1, -0.6]]), L)
    for function in (loop.abscissa, lambda x: loop.gain(x, -2.0), alone.gain):
        slopes = []
        for i in range(theta.size):
            ends = [function(theta + h * np.eye(1, theta.size, i)).value for h in (-1e-6, 1e-6)]
            slopes.append((ends[1] - ends[0]) / 2e-6)
        np.testing.assert_allclose(function(theta).in_gain[0], slopes, rtol=1e-4, atol=1e-5)


@pytest.fixture(scope="module")
def designed() -> Any:
    """A slow plant whose depth is known half a second late, with noise."""
    return design_output_feedback(SLOW, [DEPTH])


def test_a_design_is_certified_and_has_less_gamma_than_other_gains(designed: Any) -> None:
    """Its gamma is near the exact norm of its pair, below that of other gains."""
    by_hand = pair_of(SLOW, designed.measurements, [[-0.25]], [[[0.25]]])
    assert designed.exact_norm <= designed.gamma < 1.1 * designed.exact_norm
    norm = hinf_norm(close(by_hand.system, by_hand.gain))
    assert norm is not None
    assert designed.gamma < 0.9 * norm.value
    assert designed.measurements[0].noise[0] == pytest.approx(0.1, rel=1e-6)


def test_a_saved_output_feedback_is_read_with_its_figures(designed: Any) -> None:
    """Through JSON; the proof is checked again, and a changed one refused."""
    data = json.loads(json.dumps(designed.to_json()))
    again = Result.from_json(data, where="file")
    assert again.gamma == designed.gamma
    assert again.exact_norm == designed.exact_norm
    np.testing.assert_array_equal(again.L[0], designed.L[0])
    assert check_certificate(again.to_json()).valid
    data["K"][0][0] *= 1.5
    with pytest.raises(InputError, match="the proof of this design does not hold"):
        Result.from_json(data, where="file")


@pytest.mark.slow
def test_given_gains_are_kept_as_they_are() -> None:
    """K alone, L alone, or both; what cannot be certified is refused with its reason."""
    K, L = [[-0.25]], [[[0.25]]]
    both = design_output_feedback(SLOW, [DEPTH], gain=K, injections=L)
    kept_K = design_output_feedback(SLOW, [DEPTH], gain=K)
    kept_L = design_output_feedback(SLOW, [DEPTH], injections=L)
    np.testing.assert_array_equal(kept_K.K, K)
    np.testing.assert_array_equal(kept_L.L[0], L[0])
    assert max(kept_K.gamma or 0, kept_L.gamma or 0) < (both.gamma or 0)
    with pytest.raises(NotAchievableError, match="no observer and gain"):
        design_output_feedback(SLOW, [DEPTH], gain=K, injections=[[[-0.5]]])
    with pytest.raises(NotAchievableError, match="no observer and gain"):
        design_output_feedback(SLOW, [DEPTH], gain=K, injections=L, gamma=0.5)


def test_peaks_with_the_initial_error_are_proved_and_not_exceeded() -> None:
    """From one metre with an estimate of zero, and from other errors; both checkers; simulated."""
    fixes = replace(FIXES, d=0.5)
    gains: dict[str, Any] = {"gain": [[-0.25, -0.75]], "injections": [[[1.0], [0.375]]]}
    zero = design_output_feedback(AXIS, [fixes], **gains, order=0, offset=[1, 0])
    other = design_output_feedback(
        *(AXIS, [fixes]), **gains, order=0, offset=[1, 0], initial_error=[0.5, 0.25]
    )
    data = json.loads(json.dumps(zero.to_json()))
    check: Any = standalone.check
    assert check_certificate(data).valid
    assert check(json.dumps(data).encode())["guarantees"]["state_peaks"]["energy"] == "0"
    assert zero.guarantees.state_peaks is not None
    assert other.guarantees.state_peaks is not None
    again = Result.from_json(data, where="file").guarantees.state_peaks
    assert again is not None
    assert again.bounds == zero.guarantees.state_peaks.bounds
    data["pair"]["guarantees"]["state_peaks"]["bounds"][1] = "1"
    data["pair"]["claim"]["guarantees"]["state_peaks"]["bounds"][1] = "1"
    data["claim"]["guarantees"]["state_peaks"]["bounds"][1] = "1"
    del data["theorem"], data["pair"]["theorem"]
    assert "bound of row 2 is too low" in str(check_certificate(data).reason)
    with pytest.raises(RefusedError, match="bounds too low"):
        check(json.dumps(data).encode())
    for found, starts in ((zero, [1, 0, 1, 0]), (other, [1, 0, 0.5, 0.25])):
        peaks = found.guarantees.state_peaks
        assert peaks is not None
        for age in (0, 17, 50):  # hundredths of a second: Euler's method
            x = np.tile(np.array(starts, dtype=float), (3001, 1))
            A = [found.pair.system.A, np.zeros((4, 4))]
            for i, mask in enumerate(found.pair.system.selections):
                A[i] = A[i] + found.pair.system.B @ (found.pair.gain * mask)
            for t in range(3000):
                x[t + 1] = x[t] + 0.01 * (A[0] @ x[t] + A[1] @ x[max(t - age, 0)])
            reached = np.abs(x @ peaks.rows.T).max(axis=0)
            assert (reached <= 1.02 * np.array([float(b) for b in peaks.bounds])).all()
            assert reached[1] >= 0.99


@pytest.mark.slow
def test_the_vehicle_is_certified_with_positions_alone_of_any_age() -> None:
    """Eight states, the envelope's whole uncertainty, fixes of any age up to 1.5 s; random F."""
    fixes = Measurement("eta", np.eye(4, 8), 1.5, any_age=True)
    found = design_output_feedback(onboard(), [fixes])
    assert check_certificate(found.to_json()).valid
    seeded, system, norms = np.random.default_rng(1), found.pair.system, []
    for _ in range(6):
        left, _, right = np.linalg.svd(seeded.normal(size=(6, 6)))
        F = left @ right
        delays = [replace(x, A=x.A + system.E @ F @ x.H) for x in system.delays]
        delays[1] = replace(delays[1], d=float(seeded.uniform(0, 1.5)))
        moved = replace(system, A=system.A + system.E @ F @ system.H, delays=tuple(delays))
        norm = hinf_norm(close(moved, found.pair.gain))
        assert norm is not None
        norms.append(norm.value)
    assert max(norms) <= (found.gamma or 0.0)


@pytest.mark.slow
def test_auto_means_what_it_means_in_an_analysis() -> None:
    """The vehicle over slow links, 16 states: gamma of its pair is that of `analyse`, not 3.4."""
    path = Path(str(files("cosim.scenario"))) / "library" / "designs" / "auv-survey.json"
    pair = Result.from_json(json.loads(path.read_bytes()), where=str(path)).pair
    found = design_output_feedback(
        *(pair.plant, pair.measurements),
        gain=pair.K,
        injections=pair.L,
        command_age=pair.command_age,
        command_any_age=True,
        estimated=pair.estimated.tolist(),
    )
    known = analyse(pair.system, pair.gain, order="auto")
    assert (found.gamma, found.order) == (known.gamma, known.order)
    assert found.gamma == pytest.approx(2.0822, rel=1e-4)
    assert check_certificate(found.certificate).valid
