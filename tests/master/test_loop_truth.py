"""The loop against one monolithic solution of the same delay equation."""

from __future__ import annotations

import math
from bisect import bisect_left
from typing import TYPE_CHECKING

import numpy as np
import pytest
from coupled import A1, DELAY, H1, A, B, C, E, H, K, ns, section_5, system
from truth.dde import Hold, Solution, solve

from cosim.master import simulate
from cosim.network import TransportLink

if TYPE_CHECKING:
    from pathlib import Path

STOP = 2.0
FINE = {"solver.step": 1 / 512}


def plant_rate(t: float, x: np.ndarray, late: np.ndarray, u: float, w: float) -> np.ndarray:
    """Eq. (7) with section 5's numbers, F(t) = 0.5 sin t."""
    uncertain = E @ (0.5 * math.sin(t) * (H @ x + H1 @ late))
    value: np.ndarray = A @ x + A1 @ late + B * u + C * w + uncertain
    return value


def continuous_loop(there: float, back: float) -> Solution:
    """U(t) = K x(t - there - back), nothing commanded before the first value can be back."""

    def rate(t: float, x: np.ndarray, late: list[np.ndarray]) -> np.ndarray:
        u = float(K[0] @ late[1]) if t > back else 0.0
        return plant_rate(t, x, late[0], u, math.sin(t))

    return solve(rate, [10.0, 10.0], [DELAY, there + back], STOP, switches=[back] if back else [])


def sampled_loop(step: float, there: float, back: float) -> np.ndarray:
    """Solve what a Jacobi loop of sampled components is, piece by piece.

    From t_k to t_{k+1} the plant has u = K x(t_{k-1} - there - back) and w = sin t_k; u is 0
    before any command is back, and x(t) = x(0) for t < 0. `there` and `back` are multiples of
    the step.
    """
    count = round(STOP / step)
    m, n = round(there / step), round(back / step)
    times = [k * step for k in range(count + 1)]
    rows = [np.array([10.0, 10.0])]
    pieces: list[Solution] = []

    def past(t: float) -> np.ndarray:
        if t <= 0.0:
            return rows[0]
        k = max(bisect_left(times, t) - 1, 0)
        k = min(k, len(pieces) - 1)
        return pieces[k](min(t - times[k], step))

    for k in range(count):
        behind = k - 1 - n - m  # row of x behind the command in use, row 0 if none is there yet
        u = float(K[0] @ rows[max(behind, 0)]) if k - 1 - n >= 0 else 0.0
        t0, w = times[k], math.sin(times[k])

        def rate(
            s: float,
            x: np.ndarray,
            late: list[np.ndarray],
            t0: float = t0,
            u: float = u,
            w: float = w,
        ) -> np.ndarray:
            return plant_rate(t0 + s, x, late[0], u, w)

        kinks = [s - t0 for s in times[:k] if s - t0 >= -8 * DELAY]
        piece = solve(
            rate,
            lambda s, t0=t0: past(t0 + s),  # type: ignore[misc]
            [DELAY],
            step,
            switches=kinks,
        )
        pieces.append(piece)
        rows.append(piece(step))
    return np.array(rows)


@pytest.mark.parametrize(
    ("step", "there", "back"),
    [(0.1, 0.0, 0.0), (0.05, 0.0, 0.0), (0.1, 0.2, 0.1), (0.125, 0.125, 0.25)],
)
def test_loop_is_exactly_the_sampled_system(
    fmus: Path, step: float, there: float, back: float
) -> None:
    """Held inputs, one step of coupling, links on top: met to the integrator's 1e-8."""
    links = [TransportLink("sc", ns(there)), TransportLink("ca", ns(back))]
    run = simulate(section_5(fmus, step=step, stop=STOP, links=links, plant=FINE))
    got = np.stack([run.signal("plant", "x[1]"), run.signal("plant", "x[2]")], axis=1)
    exact = sampled_loop(step, there, back)
    assert np.allclose(got, exact, rtol=0, atol=1e-8), np.abs(got - exact).max()


@pytest.mark.parametrize(("there", "back"), [(0.0, 0.0), (0.2, 0.1), (0.1, 0.3)])
def test_order_of_convergence_in_the_communication_step(
    fmus: Path, there: float, back: float
) -> None:
    """Against the continuous loop the error falls with slope 1 over five halvings (Jacobi)."""
    exact = continuous_loop(there, back)
    links = [TransportLink("sc", ns(there)), TransportLink("ca", ns(back))]
    errors = []
    steps = [0.1 / 2**k for k in range(6)]
    for step in steps:
        run = simulate(section_5(fmus, step=step, stop=STOP, links=links))
        every = round(0.1 / step)
        got = np.stack([run.signal("plant", f"x[{i}]")[::every] for i in (1, 2)], axis=1)
        errors.append(np.abs(got - exact.sample(run.points_ns[::every] / 1e9)).max())
    slopes = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(slopes[-4:] > 0.85), slopes
    assert np.all(slopes[-4:] < 1.15), slopes
    assert slopes[-1] == pytest.approx(1.0, abs=0.05)
    assert errors[-1] < 0.05


def test_loop_delay_is_the_sum_of_both_directions(fmus: Path) -> None:
    """0.2 s there and 0.1 s back, or 0.1 and 0.2: after both are filled the loops are one."""
    ends = []
    for there, back in ((0.2, 0.1), (0.3, 0.0)):
        links = [TransportLink("sc", ns(there)), TransportLink("ca", ns(back))]
        # x is constant before the start and u starts at 0: hold the plant at rest so long
        run = simulate(
            section_5(
                fmus,
                step=0.05,
                stop=STOP,
                links=links,
                plant={"initial.x[1]": 0.0, "initial.x[2]": 0.0},
            )
        )
        ends.append(run.signal("plant", "x[1]"))
    assert np.array_equal(ends[0], ends[1])


def test_transport_between_the_points_is_interpolated(fmus: Path) -> None:
    """A delay that is no multiple of the step: the reader sees the line between two rows."""
    link = TransportLink("sc", ns(0.13))
    run = simulate(section_5(fmus, step=0.05, stop=1.0, links=[link]))
    t = run.points_ns / 1e9
    for i in (1, 2):
        sent, seen = run.signal("plant", f"x[{i}]"), run.signal("controller", f"x[{i}]")
        assert seen == pytest.approx(np.interp(np.maximum(t - 0.13, 0.0), t, sent), abs=1e-12)


def test_driven_input_is_constant_over_each_step(fmus: Path) -> None:
    """X' = -5 x1 - x1(t-0.3) + 4 w with w sampled and held: the reference with a Hold."""
    step = 0.1
    run = simulate(
        system(
            fmus,
            {"plant": ("DelayedPlant", {**FINE, "F.amplitude": 0.0})},
            [],
            step=step,
            stop=STOP,
            driven={"plant.w[1]": lambda t: math.cos(7 * t)},
        )
    )
    times = [k * step for k in range(round(STOP / step))]
    w = Hold(times, [math.cos(7 * t) for t in times])
    exact = solve(
        lambda t, x, late: A @ x + A1 @ late[0] + C * w(t),
        [10.0, 10.0],
        [DELAY],
        STOP,
        switches=times,
    )
    got = np.stack([run.signal("plant", f"x[{i}]") for i in (1, 2)], axis=1)
    assert np.allclose(got, exact.sample(run.points_ns / 1e9), rtol=0, atol=1e-8)


def test_last_point_comes_after_a_shorter_step(fmus: Path) -> None:
    """An end that is no multiple of the step is met, by one short step."""
    run = simulate(section_5(fmus, step=0.15, stop=1.0))
    assert run.status == "finished"
    assert run.points_ns.tolist() == [ns(0.15) * k for k in range(7)] + [ns(1.0)]


def test_points_do_not_drift(fmus: Path) -> None:
    """Point k is k times the step in integer nanoseconds; 0.1 s ten thousand times is 1000 s."""
    run = simulate(
        system(fmus, {"sea": ("WaveField", {})}, [], step=0.1, stop=1000.0),
    )
    assert run.points_ns[-1] == 1000 * 10**9
    assert np.array_equal(run.points_ns, 10**8 * np.arange(10_001))


def test_order_of_components_does_not_matter(fmus: Path) -> None:
    """Jacobi: whoever is named or stepped first, the rows are the same bits."""
    given = section_5(fmus, step=0.05, stop=1.0)
    run = simulate(given)
    turned = type(given)(
        components=dict(reversed(given.components.items())),
        connections=list(reversed(given.connections)),
        links=given.links,
        driven=given.driven,
        comm_schedule=given.comm_schedule,
        divergence=given.divergence,
    )
    other = simulate(turned)
    for signal in ("x[1]", "x[2]", "z[1]", "z[2]", "u[1]", "w[1]"):
        assert np.array_equal(run.signal("plant", signal), other.signal("plant", signal))


def test_feedthrough_is_read_at_the_same_point(fmus: Path) -> None:
    """z of one plant drives w of a second: its own z follows in the same row."""
    run = simulate(
        system(
            fmus,
            {"second": ("DelayedPlant", {}), "first": ("DelayedPlant", {})},
            [("first.z[1]", "second.w[1]")],
            step=0.1,
            stop=1.0,
            driven={"first.w[1]": math.cos},
        )
    )
    w = np.cos(run.points_ns / 1e9)
    z = -run.signal("first", "x[1]") + 4 * w
    assert run.signal("first", "z[1]") == pytest.approx(z, abs=1e-12)
    assert np.array_equal(run.signal("second", "w[1]"), run.signal("first", "z[1]"))
    z2 = -run.signal("second", "x[2]") + 3 * z
    assert run.signal("second", "z[2]") == pytest.approx(z2, abs=1e-12)


@pytest.mark.parametrize("delay", [0.03, 0.1, 0.25])
def test_feedthrough_over_a_transport_link(fmus: Path, delay: float) -> None:
    """Also with a delay below the step, where the present row is needed for the line."""
    run = simulate(
        system(
            fmus,
            {"second": ("DelayedPlant", {}), "first": ("DelayedPlant", {})},
            [("first.z[1]", "second.w[1]", "line")],
            step=0.1,
            stop=1.0,
            links=[TransportLink("line", ns(delay))],
            driven={"first.w[1]": math.cos},
        )
    )
    t = run.points_ns / 1e9
    sent = run.signal("first", "z[1]")
    seen = np.interp(np.maximum(t - delay, 0.0), t, sent)
    assert run.signal("second", "w[1]") == pytest.approx(seen, abs=1e-12)
