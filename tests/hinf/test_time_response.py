"""Step, impulse, forced and initial responses against closed forms and other integrators."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest
from truth_of_late_loops import LateLoop

from cosim.core import InputError
from cosim.hinf import Delay, DelaySystem, lti
from cosim.hinf.delay_lti import dead_time, feedback, parallel
from cosim.models import DelayLine


def closed(k: float, a: float, tau: float) -> Any:
    return (lti(control.tf([k], [1, a])) * dead_time(tau)).feedback()


@pytest.mark.parametrize(
    ("k", "a", "tau"), [(2.0, 1.0, 0.5), (1.0, 0.0, 1.0), (0.9, 0.3, 3.0), (3.0, 1.0, 1e-2)]
)
def test_a_loop_of_first_order_to_rounding(k: float, a: float, tau: float) -> None:
    """A sum of incomplete gamma functions in forty digits; a short delay is no longer work."""
    t = np.linspace(0.0, 20.0 if tau > 0.1 else 0.5, 83)
    y = closed(k, a, tau).step_response(t).outputs
    assert np.abs(y - LateLoop(k, a, tau).step(t)).max() < 2e-14


def test_what_grows_grows_as_it_should() -> None:
    """An unstable loop, to thirteen digits of its largest value, and the estimate knows it."""
    t = np.linspace(0.0, 15.0, 40)
    found = closed(5.0, 1.0, 1.0).step_response(t)
    truth = LateLoop(5.0, 1.0, 1.0).step(t)
    worst = np.abs(found.outputs - truth).max()
    assert worst < 1e-12 * np.abs(truth).max()
    assert found.error < 1e-12 * np.abs(truth).max()


def test_a_neutral_loop_is_a_staircase_for_ever() -> None:
    """0.5 e^{-0.3 s} in feedback: every jump is met, from its right side."""
    t = np.linspace(0.0, 30.0, 101)  # every 0.3 s, on the jumps themselves
    y = (0.5 * dead_time(0.3)).feedback().step_response(t).outputs
    truth = -np.cumsum((-0.5) ** np.arange(t.size)) + 1.0
    assert np.abs(y - truth).max() < 1e-15


def test_delays_that_have_no_common_measure() -> None:
    """Two late feedbacks, 1 and sqrt 2: the double sum of their powers, and of binomials."""
    loop = DelaySystem(
        [[0.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(1.0, [[-0.4]]), Delay(2**0.5, [[-0.3]])]
    )
    t = np.linspace(0.0, 12.0, 49)
    truth = np.zeros(t.size)
    for i in range(13):
        for j in range(10):
            x = np.maximum(t - i - j * 2**0.5, 0.0)
            n = i + j
            truth += (
                math.comb(n, i) * (-0.4) ** i * (-0.3) ** j * x ** (n + 1) / math.factorial(n + 1)
            )
    assert np.abs(lti(loop).step_response(t).outputs - truth).max() < 5e-14


def test_a_boundary_layer_is_not_stepped_over() -> None:
    """A fast pole in a slow loop: against the same loop with other stages, and without the pole."""
    P = control.tf([1], [1e-5, 1, 0])
    found = (P * dead_time(1.0)).feedback().step_response(np.linspace(0, 20, 201))
    assert found.error < 2e-14
    without = closed(1.0, 0.0, 1.0).step_response(np.linspace(0, 20, 201)).outputs
    assert 1e-6 < np.abs(found.outputs - without).max() < 1e-4


def test_the_delay_line_of_the_fmus_agrees() -> None:
    """Runge-Kutta of order four on a system of two states with two delays, and its input."""
    A, A1, A2 = (
        np.array([[-1.0, 1.0], [-2.0, -0.5]]),
        np.diag([-0.3, 0.4]),
        np.array([[0, 0.2], [0.1, 0]]),
    )
    B = np.array([[1.0], [0.5]])
    system = DelaySystem(A, C=B, D=np.eye(2), delays=[Delay(0.3, A1), Delay(0.7, A2)])
    line = DelayLine([0.0, 0.0], [0.3, 0.7], 2e-3)

    def slope(_: float, x: Any, late: Any) -> Any:
        return (A @ x + A1 @ late[0] + A2 @ late[1] + B[:, 0]).tolist()

    line.advance(3.0, slope, jump=True)
    y = lti(system).step_response([0.0, 3.0]).outputs[:, 0, -1]
    np.testing.assert_allclose(y, line.x, rtol=1e-10)


def test_an_impulse_is_the_slope_of_a_step_and_passes_through() -> None:
    """The state jumps; the impulse that goes through a late direct part stands beside it."""
    L = parallel(control.tf([2], [1, 1]), 3) * dead_time(0.5)
    found = L.impulse_response(np.linspace(0.0, 3.0, 61))
    t = found.time
    assert [(s, w.tolist()) for s, w in found.impulses] == [(0.5, [[3.0]])]
    np.testing.assert_allclose(
        found.outputs, np.where(t >= 0.5 - 1e-12, 2 * np.exp(0.5 - t), 0), atol=1e-14
    )
    again = (0.5 * dead_time(1.0)).feedback().impulse_response(3.5)
    assert [(s, w[0, 0]) for s, w in again.impulses] == [(1.0, 0.5), (2.0, -0.25), (3.0, 0.125)]


@pytest.mark.parametrize("hold", ["line", "constant"])
def test_a_sampled_input_is_what_its_samples_say(hold: Any) -> None:
    """Against the late first-order lag by hand, on even and on uneven times."""
    G = lti(control.tf([1], [1, 1]), input_delay=0.25)
    for t in (np.linspace(0.0, 4.0, 41), np.array([0.0, 0.1, 0.5, 0.6, 1.7, 2.0, 3.5, 4.0])):
        u = np.cos(3 * t)
        found = G.forced_response(t, u, hold=hold).outputs
        fine = np.unique(np.concatenate([np.linspace(0, 4, 8_001), t]))
        late = 0.5 * (fine[1:] + fine[:-1]) - 0.25
        latest = np.maximum(np.searchsorted(t, late, side="right") - 1, 0)
        value = np.interp(late, t, u) if hold == "line" else u[latest]
        value[late < 0.0] = 0.0
        state = np.zeros(fine.size)
        for k, (h, v) in enumerate(zip(np.diff(fine), value, strict=True)):
            state[k + 1] = math.exp(-h) * state[k] + (1 - math.exp(-h)) * v
        np.testing.assert_allclose(found, np.interp(t, fine, state), atol=1e-7)
    step = G.step_response(t).outputs
    np.testing.assert_allclose(G.forced_response(t, np.ones_like(t)).outputs, step, atol=1e-15)


def test_an_initial_state_with_and_without_a_past() -> None:
    """x' = -x(t-1): 1 - t up to 1 from a constant past, 1 from rest."""
    loop = lti(DelaySystem([[0.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(1.0, [[-1.0]])]))
    t = np.linspace(0.0, 1.9, 20)
    rest = loop.initial_response([1.0], t).outputs
    np.testing.assert_allclose(rest, np.where(t < 1, 1.0, 2.0 - t), atol=1e-15)
    past = loop.initial_response([1.0], t, before="constant").outputs
    np.testing.assert_allclose(past, np.where(t < 1, 1 - t, 1 - t + 0.5 * (t - 1) ** 2), atol=1e-15)


def test_mimo_responses_have_one_column_per_input() -> None:
    """As in python-control: (outputs, inputs, times)."""
    G = lti(control.tf([[[1], [2]]], [[[1, 1], [1, 1]]]), io_delay=[[0.5, 1.0]])
    t, y = G.step_response(np.linspace(0, 3, 7))
    assert y.shape == (1, 2, 7)
    np.testing.assert_allclose(y[0, 1], np.where(t > 1, 2 - 2 * np.exp(1 - t), 0), atol=1e-15)
    u = np.array([np.ones(7), np.zeros(7)])
    np.testing.assert_allclose(G.forced_response(t, u).outputs, y[0, 0], atol=1e-15)


def test_without_times_it_goes_on_until_it_has_settled() -> None:
    """Of a stable loop the last value is that at rest, to a per mille."""
    for loop, last in (
        (closed(2.0, 1.0, 0.5), 2 / 3),
        (feedback(1, lti(control.tf([2], [1, 1])) * dead_time(0.5)), 1 / 3),
    ):
        assert loop.step_response().outputs[-1] == pytest.approx(last, rel=2e-3)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda G: G.step_response(-1.0), "not an end"),
        (lambda G: G.step_response([0.0, 2.0, 1.0]), "each later"),
        (lambda G: G.step_response([-1.0, 2.0]), "before 0"),
        (lambda G: G.step_response("soon"), "not an end.*\\n.*soon|soon"),
        (lambda G: G.forced_response([0.0, 1.0], [1.0]), "1 inputs by 2 times"),
        (lambda G: G.forced_response([0.0, 1.0], [1.0, 1.0], hold="spline"), "line or constant"),
        (lambda G: G.initial_response([1.0, 2.0]), "1 finite"),
        (lambda G: G.initial_response([1.0], before="yesterday"), "rest or constant"),
    ],
)
def test_times_and_inputs_that_are_none_are_refused(ask: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ask(closed(1.0, 1.0, 1.0))
