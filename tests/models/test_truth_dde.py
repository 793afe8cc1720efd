"""The reference solver for delay equations against closed forms and another tool."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from truth.dde import Hold, smooth_segments, solve

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def ramp(t: Fraction, power: int) -> Fraction:
    """(t)_+^power / power!, the inverse Laplace transform of s^-(power+1)."""
    return t**power / math.factorial(power) if t > 0 else Fraction(0)


def two_delays_exactly(t: float, a: float, b: float, d: float, e: float) -> float:
    """X' = -a x(t-d) - b x(t-e), history 1, from its Laplace transform.

    X = 1/s - (a+b)/s^2 sum_n (-1)^n ((a exp(-ds) + b exp(-es))/s)^n, in rational arithmetic.
    """
    T, A, B, D, E = (Fraction(v) for v in (t, a, b, d, e))
    total = Fraction(1)
    for i in range(int(T / D) + 1):
        for j in range(int(T / E) + 1):
            weight = math.comb(i + j, i) * (-A) ** i * (-B) ** j
            total -= (A + B) * weight * ramp(T - i * D - j * E, i + j + 1)
    return float(total)


def test_simplest_delay_equation_at_its_known_values() -> None:
    """X' = -x(t-1), history 1: 0, -1/2, -1/6 and 19/120 at t = 1, 2, 3 and 5."""
    x = solve(lambda _t, _x, late: -late[0], [1.0], [1.0], 5.0)
    got = [x(t)[0] for t in (1.0, 2.0, 3.0, 5.0)]
    assert got == pytest.approx([0.0, -1 / 2, -1 / 6, 19 / 120], rel=0, abs=1e-13)
    assert x(-0.4)[0] == 1.0


@pytest.mark.parametrize(("d", "e"), [(1.0, 1.5), (0.3, 1.0), (math.sqrt(2) / 2, 1.0)])
def test_two_delays_follow_their_laplace_transform(d: float, e: float) -> None:
    """Commensurate or not, two delays give the piecewise polynomials of the transform."""
    a, b = 0.7, 1.1
    x = solve(lambda _t, _x, late: -a * late[0] - b * late[1], [1.0], [d, e], 6.0)
    for t in np.linspace(0.1, 6.0, 37):
        assert x(t)[0] == pytest.approx(two_delays_exactly(t, a, b, d, e), rel=0, abs=2e-11)


def test_late_state_next_to_the_present_one_and_a_delay_of_zero() -> None:
    """X' = -2x + x(t-0) is x' = -x; with x(t-1) added it is the variation of constants."""
    x = solve(lambda _t, x, late: -2 * x + late[0], [3.0], [0.0], 2.0)
    assert x(2.0)[0] == pytest.approx(3 * math.exp(-2), abs=1e-11)
    x = solve(lambda _t, x, late: -x + late[0] + 0.5 * late[1], [1.0], [0.0, 1.0], 2.0)
    # x' = x(t-1)/2: 1 + t/2, then 3/2 + s/2 + s^2/8 with s = t - 1.
    assert [x(0.6)[0], x(1.4)[0]] == pytest.approx([1.3, 1.5 + 0.2 + 0.02], abs=1e-12)


def test_nonlinear_equation_follows_its_closed_form() -> None:
    """Hutchinson's x' = r x (1 - x(t-1)): exponential in the first delay, then its integral."""
    r, h = 1.8, 0.4
    x = solve(lambda _t, x, late: r * x * (1 - late[0]), [h], [1.0], 2.0)
    first = h * math.exp(r * (1 - h))
    for s in (0.25, 0.5, 0.9, 1.0):
        assert x(s)[0] == pytest.approx(h * math.exp(r * (1 - h) * s), rel=1e-11)
        exponent = r * s - h / (1 - h) * math.expm1(r * (1 - h) * s)
        assert x(1 + s)[0] == pytest.approx(first * math.exp(exponent), rel=1e-11)


def test_history_may_be_a_function() -> None:
    """Sin t, continued from its own past, solves x' = -x(t - pi/2)."""
    x = solve(lambda _t, _x, late: -late[0], lambda t: [math.sin(t)], [math.pi / 2], 10.0)
    t = np.linspace(-1, 10, 111)
    assert np.allclose(x.sample(t)[:, 0], np.sin(t), rtol=0, atol=1e-11)


def test_kink_of_the_history_is_met() -> None:
    """The history |t + 1/2| gives x' = x(t-1) two parabolas that meet at t = 1/2."""
    x = solve(lambda _t, _x, late: late[0], lambda t: [abs(t + 0.5)], [1.0], 1.0, switches=[-0.5])
    # x(0) = 1/2; the slope at t is |t - 1/2|.
    assert [x(0.25)[0], x(0.5)[0]] == pytest.approx([0.59375, 0.625], abs=1e-13)
    assert x(1.0)[0] == pytest.approx(0.75, abs=1e-13)


@pytest.mark.parametrize("period", [0.1, 0.25, 0.37])
def test_zero_order_hold_input_follows_its_step_responses(period: float) -> None:
    """X' = -x(t-d) + u with u held: the sum of the exact responses to its jumps."""
    d, end = 0.3, 3.0
    times = [k * period for k in range(math.ceil(end / period))]
    values = [math.cos(5 * k) for k in range(len(times))]
    u = Hold(times, values)
    x = solve(lambda t, _x, late: -late[0] + u(t), [0.0], [d], end, switches=times)

    def exactly(t: float) -> float:
        total, before = Fraction(0), 0.0
        for start, value in zip(times, values, strict=True):
            since = Fraction(t) - Fraction(start)
            images = range(max(0, int(since / Fraction(d)) + 1))
            response = sum((-1) ** n * ramp(since - n * Fraction(d), n + 1) for n in images)
            total += (Fraction(value) - Fraction(before)) * response
            before = value
        return float(total)

    for t in np.linspace(0.05, end, 43):
        assert x(t)[0] == pytest.approx(exactly(t), rel=0, abs=1e-11)


def test_segments_end_on_switches_and_their_images() -> None:
    """Every stop is a sum of a switch and delays; those equal but for rounding count once."""
    segments = smooth_segments([0.7], [0.3, 0.5], 1.7)
    stops = sorted({round(t, 9) for pair in segments for t in pair})
    sums = {(3 * i + 5 * j) / 10 for i in range(8) for j in range(8) if i + j <= 7}
    expected = {s for s in sums | {0.7 + s for s in sums} if s < 1.7 + 1e-9} | {1.7}
    assert stops == pytest.approx(sorted({round(t, 9) for t in expected}))
    assert all(0 < b - a <= 0.3 + 1e-9 for a, b in segments)
    assert 0.7 in {a for a, _ in segments}


def test_time_beyond_the_end_is_refused() -> None:
    """A solution is not extrapolated."""
    x = solve(lambda _t, _x, late: -late[0], [1.0], [1.0], 2.0)
    with pytest.raises(ValueError, match=r"at most 2\.0, got 2\.1"):
        x(2.1)


A = np.array([[-5.0, 0.0], [6.0, -10.0]])
A1 = np.array([[-1.0, 0.0], [2.0, 1.0]])
B = np.array([[-1.0], [3.0]])
C = np.array([4.0, 3.0])
E = -0.1 * np.eye(2)
H = np.array([[0.2, 0.0], [1.0, 2.0]])
H1 = np.array([[-1.0, 2.0], [0.0, -0.3]])
K = np.array([[0.6432, -0.5679]])
DELAY = 0.3


def section_5(t: float, x: np.ndarray, late: Sequence[np.ndarray]) -> np.ndarray:
    """Close the loop of the paper's section 5, F(t) = 0.5 sin t, w = sin t."""
    uncertain = E @ (0.5 * math.sin(t) * (H @ x + H1 @ late[0]))
    return (A + B @ K) @ x + A1 @ late[0] + uncertain + C * math.sin(t)


def test_section_5_agrees_with_jitcdde(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The paper's example, to 3e-10, as compiled and integrated by another tool.

    jitcdde runs at a fixed step that divides the delay, third order: 3e-4 s leaves 6e-10 and
    1e-4 s leaves 4e-11. Its first step of 1e-11 s replaces the slope of the constant past.
    """
    import symengine  # noqa: PLC0415 - a compiler's weight, for one test
    from jitcdde import jitcdde, t, y  # noqa: PLC0415

    now, late = [y(0), y(1)], [y(0, t - DELAY), y(1, t - DELAY)]
    F = symengine.sin(t) / 2
    inner = [F * sum(H[i, j] * now[j] + H1[i, j] * late[j] for j in range(2)) for i in range(2)]
    loop = A + B @ K
    rates = [
        sum(loop[i, j] * now[j] + A1[i, j] * late[j] + E[i, j] * inner[j] for j in range(2))
        + C[i] * symengine.sin(t)
        for i in range(2)
    ]
    # Given the delays and told not to simplify, jitcdde does without sympy.
    tool = jitcdde(rates, delays=[0, DELAY], max_delay=DELAY, verbose=False)
    monkeypatch.chdir(tmp_path)  # it compiles with the settings of the project it stands in
    tool.constant_past([10.0, 10.0])
    tool.compile_C(simplify=False, do_cse=False)
    tool._tmpdir.cleanup()  # loaded by now; left to itself it ends in a ResourceWarning
    tool.set_integration_parameters()
    tool.integrate_blindly(1e-11, 1e-11)
    x = solve(section_5, [10.0, 10.0], [DELAY], 6.0)
    for k in range(1, 21):
        assert np.allclose(
            tool.integrate_blindly(k * DELAY, 1e-4), x(k * DELAY), rtol=0, atol=3e-10
        )
