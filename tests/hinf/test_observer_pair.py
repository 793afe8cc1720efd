"""The pair of plant and observer: its equations, its certificate, and that nothing beats it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, analyse, check_certificate, hinf_norm
from cosim.hinf.certificate import (
    ObserverPair,
    exact_noise,
    output_feedback_to_json,
    pair_of,
    standalone,
)
from cosim.hinf.certificate.standalone import RefusedError
from cosim.hinf.delay_lti import close
from cosim.models import Measurement

AXIS = DelaySystem(
    [[0, 1], [0, 0]], [[0], [1]], [[0], [1]], [[0.1, 0.0], [0.0, 0.0]], D2=[[0], [1]], name="axis"
)
"""One axis of the vehicle, under accelerations w and u."""

K = [[-0.06, -0.53]]
STEP = 0.01  # s


def position(d: float = 1.5, **known: Any) -> Measurement:
    """A position fix of any age up to d."""
    return Measurement("position", [[1, 0]], d, any_age=True, **known)


def lagged() -> tuple[DelaySystem, list[Measurement], list[list[float]], list[Any], list[bool]]:
    """An axis with late onboard damping, a thruster's lag that is known, and two sensors."""
    plant = DelaySystem(
        A=[[0.0, 1.0, 0.0], [0.0, -0.1, 1.0], [0.0, 0.0, -2.0]],
        B=[[0], [0], [2]],
        C=[[0.0, 0.0], [1.0, 0.5], [0.0, 0.0]],
        D=[[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]],
        D1=[[0.0, 0.25], [0.0, 0.0]],
        D2=[[0], [1]],
        E=[[0.0], [0.1], [0.0]],
        H=[[0.0, 0.5, 0.25]],
        delays=[Delay(0.5, np.diag([0, -0.05, 0]), [[0, 0.25, 0]])],
    )
    sensors = [
        Measurement("position", [[1, 0, 0]], 0.9, any_age=True, noise=[0.1]),
        Measurement("speed", [[0, 1, 0.5]], 0.3, any_age=True, noise=[0.03], over="onboard"),
    ]
    gains = [[[0.53], [0.057], [0]], [[0.1], [0.4], [0]]]
    return plant, sensors, [[-0.06, -0.53, 0.1]], gains, [True, True, False]


@pytest.mark.parametrize(("command_age", "varies"), [(0.0, False), (0.2, False), (0.0, True)])
def test_the_pair_moves_as_plant_and_observer_do(command_age: float, varies: bool) -> None:  # noqa: FBT001
    """Both are written out here, with packets, stamps, stored estimates, held innovations, F.

    varies : the delay inside the plant; the observer takes it to be its greatest.
    """
    plant, sensors, K, L, estimated = lagged()
    plant = replace(plant, delays=(replace(plant.delays[0], any_age=varies),))
    pair = pair_of(plant, sensors, K, L, command_age=command_age, estimated=estimated)
    steps, seeded = 800, np.random.default_rng(5)
    F = np.sign(np.sin(0.9 * np.arange(steps) * STEP))
    w = seeded.normal(size=(steps, 2))
    stamps = [_stamps(x, steps, seeded) for x in sensors]
    noise = [np.repeat(seeded.normal(size=steps // 8 + 1), 8)[:steps] for _ in sensors]
    x, xh = np.zeros((steps + 1, 3)), np.zeros((steps + 1, 3))
    z = np.zeros((steps, 2))
    delta = [np.outer(plant.E, H) for H in (plant.H, plant.delays[0].H)]
    d, late = round(0.5 / STEP), round(command_age / STEP)
    within = np.full(steps, d) - (np.arange(steps) % 37 if varies else 0)
    x[0] = [1.0, 0.5, 0.25]
    xh[0, 2] = x[0, 2]  # known
    for t in range(steps):
        u = np.array(K) @ xh[max(t - late, 0)] if t >= late else np.zeros(1)
        inside = [age[t] for age in (within, np.full(steps, d))]
        before = [v[t - a] if t >= a else np.zeros(3) for v, a in zip((x, xh), inside, strict=True)]
        own = [plant.A @ v + plant.delays[0].A @ b for v, b in zip((x[t], xh[t]), before)]  # noqa: B905
        unknown = F[t] * (delta[0] @ x[t] + delta[1] @ before[0])
        y = np.zeros(3)
        for sensor, gain, stamp, v in zip(pair.measurements, L, stamps, noise, strict=True):
            if (s := stamp[t]) >= 0:
                innovation = sensor.C @ x[s] - sensor.C @ xh[s]
                y += np.array(gain) @ (innovation + sensor.noise[0] * v[t])
        x[t + 1] = x[t] + STEP * (own[0] + unknown + plant.B @ u + plant.C @ w[t])
        xh[t + 1] = xh[t] + STEP * (own[1] + plant.B @ u + y)
        z[t] = plant.D @ x[t] + plant.D1 @ w[t] + plant.D2 @ u
    innovation = [np.where(s >= 0, v, 0.0) for s, v in zip(stamps, noise, strict=True)]
    ages = [within, *([np.full(steps, d)] if varies else [])]
    ages += [*([np.full(steps, late)] if late else []), *_ages(stamps)]
    state, output = _simulated(pair, x[0], xh[0], np.column_stack([w, *innovation]), F, ages)
    np.testing.assert_allclose(state, np.hstack([x, (x - xh)[:, :2]]), atol=1e-11)
    np.testing.assert_allclose(output, z, atol=1e-11)
    assert np.abs(x).max() > 0.5  # it moved


def _stamps(sensor: Measurement, steps: int, seeded: Any) -> Any:
    """The stamp of the packet in use at every step, -1 before the first: any age up to d."""
    stamps, newest, at = np.full(steps, -1), -1, 0
    for t in range(steps):
        if at <= t - round(seeded.uniform(0.1, 0.5) * sensor.d / STEP):
            newest, at = at, min(t, at + round(0.4 * sensor.d / STEP))
        stamps[t] = newest
    return stamps


def _ages(stamps: list[Any]) -> list[Any]:
    """The ages in steps; before the first packet one that is before the start."""
    return [np.where(s >= 0, np.arange(len(s)) - s, len(s) + 1) for s in stamps]


def _simulated(
    pair: ObserverPair, x: Any, xh: Any, w: Any, F: Any, ages: list[Any]
) -> tuple[Any, Any]:
    """Euler's method for the closed loop of the pair's `DelaySystem`, at these ages in steps."""
    system, K = pair.system, pair.gain
    steps, masks = len(w), system.selections
    state, z = np.zeros((steps + 1, len(system.A))), np.zeros((steps, len(system.D)))
    state[0] = [*x, *(x - xh)[pair.estimated]]
    late = [(x.A, x.H, S) for x, S in zip(system.delays, masks[1:], strict=True)]
    terms = [(system.A, system.H, masks[0]), *late]
    for t in range(steps):
        at = [t, *(t - age[t] for age in ages)]
        values = [state[s] if s >= 0 else 0 * state[0] for s in at]
        u = sum((K * S) @ v for (_, _, S), v in zip(terms, values, strict=True))
        rate = sum(
            (A + F[t] * system.E @ H) @ v for (A, H, _), v in zip(terms, values, strict=True)
        )
        state[t + 1] = state[t] + STEP * (rate + system.B @ u + system.C @ w[t])
        z[t] = system.D @ state[t] + system.D1 @ w[t] + system.D2 @ u
    return state, z


def test_a_scalar_plant_with_an_observer_has_the_norm_of_its_closed_form() -> None:
    """Fresh y, x' = u + w, z = x, K = -k: (s+k+l) / ((s+k)(s+l)) at s = 0; l k / (kl) from v."""
    plant = DelaySystem([[0]], [[1]], [[1]], [[1]])
    k, l, n = 2.0, 0.5, 0.25
    pair = pair_of(plant, [Measurement("x", [[1]], noise=[n])], [[-k]], [[[l]]])
    found = analyse(pair.system, pair.gain)
    truth = np.hypot(k + l, k * l * n) / (k * l)
    assert found.exact_norm == pytest.approx(truth, rel=1e-9)
    assert found.gamma is not None
    assert truth <= found.gamma <= truth * (1 + 1e-4)


@pytest.fixture(scope="module")
def proved() -> dict[str, Any]:
    """The certificate of the axis with position fixes of any age up to 1.5 s."""
    pair = pair_of(AXIS, [position(noise=[0.1])], K, [[[0.53], [0.057]]])
    found = analyse(pair.system, pair.gain)
    assert found.certificate is not None
    return json.loads(json.dumps(output_feedback_to_json(pair, found.certificate)))  # type: ignore[no-any-return]


def _accepted(data: Any) -> tuple[bool, bool]:
    """What the prover and the second checker say."""
    verdicts: list[bool] = []
    checks: list[Callable[[], bool]] = [
        lambda: check_certificate(data).valid,
        lambda: _standalone(data),
    ]
    for check in checks:
        try:
            verdicts.append(check())
        except (InputError, RefusedError):
            verdicts += [False]
    return verdicts[0], verdicts[1]


def _standalone(data: Any) -> bool:
    check: Any = standalone.check
    return bool(check(json.dumps(data).encode()))


def test_both_checkers_prove_an_output_feedback(proved: dict[str, Any]) -> None:
    """From the file alone; the theorem says what the observer is."""
    assert _accepted(proved) == (True, True)
    assert "C_i xh" in proved["theorem"][1]
    assert float(analyse_gamma(proved)) < 11.69  # 11.68, the exact norm is 11.677


def analyse_gamma(data: dict[str, Any]) -> Any:
    """The claimed gamma."""
    top, _, bottom = data["claim"]["gamma"].partition("/")
    return int(top) / int(bottom or 1)


def test_both_checkers_prove_a_pair_whose_plant_has_a_delay_that_varies() -> None:
    """The observer takes it to be its greatest: one more term, which both make again."""
    plant, sensors, K, L, estimated = lagged()
    plant = replace(plant, delays=(replace(plant.delays[0], any_age=True),))
    pair = pair_of(plant, sensors, K, L, estimated=estimated, command_age=0.1)
    found = analyse(pair.system, pair.gain, order=0)
    assert found.certificate is not None
    data = json.loads(json.dumps(output_feedback_to_json(pair, found.certificate)))
    assert _accepted(data) == (True, True)
    data["pair"]["system"]["delays"][1]["A"][4][1] = 0.0
    assert _accepted(data) == (False, False)


CHANGES: dict[str, Callable[[dict[str, Any]], Any]] = {
    "K": lambda c: c["K"][0].__setitem__(0, -0.061),
    "L": lambda c: c["L"][0][1].__setitem__(0, 0.058),
    "C": lambda c: c["measurements"][0]["C"][0].__setitem__(1, 0.5),
    "age": lambda c: c["measurements"][0].update(d=1.6),
    "kind of age": lambda c: c["measurements"][0].update(any_age=False),
    "noise": lambda c: c["measurements"][0].update(noise=[0.25]),
    "plant": lambda c: c["plant"]["A"][1].__setitem__(1, 0.5),
    "command": lambda c: c.update(command_age=0.1),
    "estimated": lambda c: c.update(estimated=[True, False]),
    "error of the pair": lambda c: c["pair"]["system"]["A"][2].__setitem__(3, 0.9),
    "gain of the pair": lambda c: c["pair"]["K"][0].__setitem__(2, 0.05),
    "feedback of the pair": lambda c: c["pair"]["system"]["feedback"].__setitem__(1, [True] * 4),
    "claim": lambda c: c["claim"].update(gamma="11"),
    "claim of the pair": lambda c: c["pair"]["claim"].update(gamma="11"),
}


@pytest.mark.parametrize("change", CHANGES)
def test_no_other_pair_passes_for_this_one(proved: dict[str, Any], change: str) -> None:
    """Every part of plant, observer and pair is held against the others, by both checkers."""
    data = json.loads(json.dumps(proved))
    CHANGES[change](data)
    assert data != proved
    assert _accepted(data) == (False, False)


def test_noise_is_rounded_up_until_its_products_with_L_are_exact() -> None:
    """An L of few digits costs nothing, one of 53 bits at most a factor of two."""
    assert exact_noise(np.array([[0.5], [0.0625]]), [0.1]) == (0.1,)
    (size,) = exact_noise(np.array([[0.53], [0.057]]), [0.1])
    assert 0.1 <= size <= 0.2
    for value in (0.53, 0.057):
        assert Fraction(value) * Fraction(size) == Fraction(value * size)


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"measurements": []}, "measurements"),
        ({"measurements": [position(), position()], "L": [[[1], [1]]] * 2}, "position"),
        ({"measurements": [Measurement("x", [[1, 0, 0]])]}, "measurement x: C"),
        ({"L": []}, "L"),
        ({"L": [[[1]]]}, "L of position"),
        ({"K": [[1]]}, "K"),
        ({"command_age": -1.0}, "command_age"),
        ({"estimated": [True, False]}, "estimated: state 2"),
        ({"estimated": [True]}, "estimated"),
        ({"system": replace(AXIS, feedback=(True, False))}, "axis: feedback"),
        ({"system": DelaySystem(AXIS.A, name="axis")}, "axis: feedback"),
    ],
)  # fmt: skip
def test_what_is_no_pair_is_refused_by_name(change: dict[str, Any], place: str) -> None:
    """Each message names the part."""
    asked: dict[str, Any] = {"measurements": [position()], "K": K, "L": [[[0.5], [0.1]]]}
    asked |= {"system": AXIS} | change
    with pytest.raises(InputError) as refused:
        pair_of(**asked)
    assert place in str(refused.value)


def test_no_age_or_uncertainty_is_above_the_certified_gamma() -> None:
    """Exact norms at random constant ages below the measurements', for random F, of one pair."""
    plant, sensors, K, L, estimated = lagged()
    pair = pair_of(plant, sensors, K, L, estimated=estimated)
    found = analyse(pair.system, pair.gain, order=0)
    assert found.certified, found.reason
    seeded, norms = np.random.default_rng(3), []
    for _ in range(12):
        F, s = seeded.uniform(-1, 1), pair.system
        late = [replace(x, A=x.A + F * s.E @ x.H, d=x.d * share, any_age=False) for x, share in
                zip(s.delays, [1.0, *seeded.uniform(size=2)], strict=True)]  # fmt: skip
        nominal = replace(s, A=s.A + F * s.E @ s.H, delays=tuple(late))
        norm = hinf_norm(close(nominal, pair.gain))
        assert norm is not None
        norms.append(norm.value)
    assert found.gamma is not None
    assert max(norms) <= found.gamma < 3 * max(norms)
