"""Feedback of single states, at ages of their own: designs, proofs and integral action."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest

from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, analyse, check_certificate, design, greatest_delay
from cosim.hinf.certificate import system_from_json, system_to_json
from cosim.hinf.problem import system_from_toml, with_integral, with_measured, without_integrals
from cosim.hinf.synthesis import LoopGain

ZERO = np.zeros((2, 2))


def axis(*, any_age: bool = False) -> DelaySystem:
    """Give one axis of a vehicle whose position is a second old and whose speed is fresher."""
    return DelaySystem(
        [[0, 1], [0, 0]],
        [[0], [1]],
        [[0], [1]],
        [[0.1, 0], [0, 0]],
        D2=[[0], [1]],
        delays=[
            Delay(1.0, ZERO, feedback=(True, False), any_age=any_age),
            Delay(0.2, ZERO, feedback=(False, True), any_age=any_age),
        ],
    )


def drive() -> DelaySystem:
    """Give a mass with an actuator of its own speed, which nobody measures."""
    return DelaySystem(
        [[0, 1, 0], [0, 0, 1], [0, 0, -3]],
        [[0], [0], [3]],
        [[0], [1], [0]],
        [[0.3, 0, 0], [0, 0, 0]],
        D2=[[0], [1]],
        delays=[Delay(0.3, np.zeros((3, 3)), feedback=(True, True, False))],
    )


def norm_at(K: Any, ages: tuple[float, float]) -> float:
    """Compute the gain of `axis` at constant ages from its equations, written out."""
    (k1, k2), (a, b) = K[0], ages
    omega = np.geomspace(1e-3, 1e2, 4000)
    s = 1j * omega
    # s^2 y = u + w,  u = k1 e^{-as} y + k2 e^{-bs} s y
    feedback = k1 * np.exp(-a * s) + k2 * np.exp(-b * s) * s
    y = 1.0 / (s**2 - feedback)
    return float(np.sqrt(np.abs(0.1 * y) ** 2 + np.abs(feedback * y) ** 2).max())


@pytest.mark.slow
def test_two_ages_in_one_state_are_designed_for_and_proved_at_all_their_ages() -> None:
    """Gamma is nearly the exact norm; for ages that vary it covers every pair of them."""
    found = design(axis(), order=1)
    here = norm_at(found.K, (1.0, 0.2))
    assert here * (1 - 1e-4) <= found.gamma < 1.1 * here
    norms = [norm_at(found.K, ages) for ages in product((0.0, 0.5, 1.0), (0.0, 0.1, 0.2))]
    anyhow = analyse(axis(any_age=True), found.K, order=1)
    assert max(norms) <= anyhow.gamma < 1.3 * max(norms)
    assert check_certificate(found.certificate).valid
    assert found.certificate["claim"]["delays"][0]["feedback"] == [True, False]


def test_a_state_that_is_not_measured_has_a_column_of_zeros() -> None:
    """Without the actuator's state a design is found whose gamma is nearly the exact norm."""
    found = design(drive())
    assert found.K[0, 2] == 0.0
    assert found.K[0, :2].all()
    assert found.abscissa < 0
    assert found.exact_norm <= found.gamma < 1.1 * found.exact_norm


def test_a_proof_is_about_its_own_feedback() -> None:
    """Another selection of states, or a gain on an unmeasured one, is not what was proved."""
    data = analyse(axis(), [[-0.2, -0.9]], order=1).certificate
    assert check_certificate(data).valid
    swapped = json.loads(json.dumps(data))
    for part in (swapped["system"], swapped["claim"]):
        for delay in part["delays"]:
            delay["feedback"] = delay["feedback"][::-1]
    assert not check_certificate(swapped).valid
    single = json.loads(json.dumps(data))
    for part in (single["system"], single["claim"]):
        part["delays"][0]["feedback"] = False
    with pytest.raises(InputError, match=r"K\[1,1\].*not measured|not measured.*K\[1,1\]"):
        check_certificate(single)


def test_gradients_are_those_of_finite_differences() -> None:
    """Abscissa and scaled gains change with K and with the scalings as their gradients say."""
    rng = np.random.default_rng(0)
    n, m = 4, 2
    matrix = rng.normal
    system = DelaySystem(
        matrix(size=(n, n)) - 2 * np.eye(n),
        matrix(size=(n, m)),
        matrix(size=(n, 2)),
        matrix(size=(3, n)),
        0.1 * matrix(size=(3, 2)),
        matrix(size=(3, m)),
        0.2 * matrix(size=(n, 2)),
        0.2 * matrix(size=(3, n)),
        [
            Delay(0.3, 0.3 * matrix(size=(n, n)), 0.1 * matrix(size=(3, n))),
            Delay(0.2, np.zeros((n, n)), feedback=(True, False, True, False)),
            Delay(0.7, np.zeros((n, n)), feedback=(False, True, False, False)),
        ],
    )
    several = replace(system, uncertainty_blocks=[[1, 2], [1, 1]])
    loop, blocks = LoopGain(system), LoopGain(several)
    alone = LoopGain(several, only_uncertain=True)
    K = 0.1 * rng.normal(size=(m, n)) * loop.free
    one, two = np.array([0.3]), np.array([0.3, -0.1])
    for function, e in (
        (lambda K, _: loop.abscissa(K), one),
        (loop.gain, one),
        (blocks.gain, two),
        (alone.gain, two),
    ):
        found = function(K, e)
        assert np.isfinite(found.value)
        for i, j in np.argwhere(loop.free):
            step = np.zeros((m, n))
            step[i, j] = 1e-4
            slope = (function(K + step, e).value - function(K - step, e).value) / 2e-4
            assert slope == pytest.approx(found.in_gain[i, j], abs=1e-4)
        for i, step in enumerate(1e-4 * np.eye(len(e))):
            slope = (function(K, e + step).value - function(K, e - step).value) / 2e-4
            assert slope == pytest.approx(found.in_scaling[i], abs=1e-4)
    # without uncertainty it is the largest singular value, computed here once more
    plain = LoopGain(system, uncertain=False).gain(K).value
    omega = np.concatenate([[0.0], np.geomspace(1e-2, 1e2, 3000)])
    gains = []
    for w in omega:
        e = [1.0, np.exp(-0.3j * w), np.exp(-0.2j * w), np.exp(-0.7j * w)]
        late = K * (e[2] * np.array([1, 0, 1, 0]) + e[3] * np.array([0, 1, 0, 0]))
        A = system.A + e[1] * system.delays[0].A + system.B @ late
        x = np.linalg.solve(1j * w * np.eye(n) - A, system.C)
        gains.append(np.linalg.norm((system.D + system.D2 @ late) @ x + system.D1, 2))
    assert np.exp(plain) == pytest.approx(max(gains), rel=1e-4)


def test_an_integral_takes_the_state_to_zero_and_is_proved_with_the_loop() -> None:
    """Its equations, written out, have no gain at zero frequency and none above gamma."""
    system = DelaySystem(
        [[0, 1], [0, -0.2]],
        [[0], [1]],
        [[0], [1]],
        [[0.3, 0], [0, 0]],
        D2=[[0], [1]],
        delays=[Delay(0.5, ZERO, feedback=True)],
    )
    found = design(with_integral(system, [0], weights=[0.06]))
    k1, k2, ki = found.K[0]
    s = 1j * np.geomspace(1e-5, 1e2, 4000)
    # xi' = y(t-d), u = k1 y(t-d) + k2 y'(t-d) + ki xi
    late = np.exp(-0.5 * s)
    feedback = (k1 + k2 * s) * late + ki * late / s
    y = 1.0 / (s**2 + 0.2 * s - feedback)
    z = np.array([0.3 * y, feedback * y, 0.06 * late / s * y])
    assert np.linalg.norm(z, axis=0).max() <= found.gamma
    assert abs(y[0]) < 1e-3  # a constant disturbance leaves nothing
    assert np.linalg.norm(z, axis=0).max() > 0.98 * found.gamma
    assert check_certificate(found.certificate).valid
    again = system_from_json(found.certificate["system"])
    assert again.integrals == 1
    assert system_to_json(again) == found.certificate["system"]


@pytest.mark.parametrize("age", [None, 0.0, 0.3])
@pytest.mark.parametrize("any_age", [False, True])
def test_the_plant_is_found_again_in_the_augmented_system(age: float | None, any_age: bool) -> None:  # noqa: FBT001
    """Whatever delay its integrals have, the system before them is the same."""
    system = axis(any_age=any_age)
    again = without_integrals(with_integral(system, [0], age=age))
    assert system_to_json(again) == system_to_json(system)


def test_files_say_what_is_measured_and_integrated() -> None:
    """`feedback` lists and `[system.integral]` give the systems of the functions."""
    text = """
        [system]
        A = [[0.0, 1.0], [0.0, -0.2]]
        B = [[0.0], [1.0]]
        {more}
        [[system.delays]]
        d = 0.5
        feedback = {feedback}
    """
    whole = system_from_toml(text.format(more="", feedback="true"), where="f.toml", name="f").system
    part = system_from_toml(
        text.format(more="", feedback="[true, false]"), where="f.toml", name="f"
    ).system
    assert system_to_json(part) == system_to_json(with_measured(whole, [0]))
    # the second state of the feedback is at once, the first late
    more = "feedback = [false, true]\n[system.integral]\nof = [1]\nage = 0.1\n"
    both = system_from_toml(
        text.format(more=more, feedback="[true, false]"), where="f.toml", name="f"
    ).system
    assert [list(s) for s in both.selections] == [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
    assert both.delays[0].A[2].tolist() == [1.0, 0.0, 0.0]
    assert not both.A[2].any()  # integrated where it is received, and only there
    assert both.delays[1].d == 0.1
    assert both.delays[1].any_age


@pytest.mark.slow
def test_a_limit_on_the_gain_goes_with_single_states() -> None:
    """Four fifths of the norm of the best one: met and certified; a given gain above is refused."""
    free = design(axis())
    limit = 0.8 * float(np.linalg.norm(free.K, 2))
    found = design(axis(), gain_limit=limit)
    assert np.linalg.norm(found.K, 2) <= limit
    assert found.certificate["claim"]["guarantees"].keys() == {"gain_limit"}
    assert check_certificate(found.certificate).valid
    assert ((found.K == 0) == (free.K == 0)).all()
    with pytest.raises(NotAchievableError, match="gain_limit"):
        design(axis(), gain=free.K, gain_limit=limit, alternatives=False)


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: with_measured(axis(), [2]), "from 1 to 2"),
        (lambda: with_integral(with_measured(axis(), [0]), [1]), "not measured"),
        (lambda: with_integral(axis(), [0, 1]), "more integrals than controls"),
        (lambda: with_integral(axis(), [[1.0, 0.0], [2.0, 0.0]]), "depend"),
        (lambda: with_integral(axis(), [0], weights=[0.0]), "weights"),
        (lambda: with_integral(with_integral(axis(), [0]), [0]), "already"),
        (lambda: design(axis(), decay=0.1), "single states"),
        (lambda: design(axis(), k1=[-1, -1], k2=[1, 1]), "single states"),
        (lambda: greatest_delay(axis(), 5.0), "single states"),
        (lambda: analyse(with_measured(axis(), [0]), [[-0.1, -0.1]]), "not measured"),
    ],
)
def test_what_cannot_be_done_is_refused(make: Any, word: str) -> None:
    """Each refusal names what was expected."""
    with pytest.raises(InputError) as caught:
        make()
    assert word in str(caught.value)


def test_a_state_is_fed_back_once() -> None:
    """Two paths for one state would be two gains."""
    with pytest.raises(ValueError, match="state 1 fed back 2 times"):
        DelaySystem(
            [[0, 1], [0, 0]],
            [[0], [1]],
            delays=[Delay(1.0, ZERO, feedback=(True, False))],
            feedback=(True, True),
        )
