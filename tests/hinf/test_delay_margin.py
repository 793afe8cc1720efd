"""Delay margins against closed forms, published numbers and the characteristic roots."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from shared import sampled

from cosim.core import InputError
from cosim.hinf import delay_margin, spectral_abscissa
from cosim.hinf.delay_lti import ClosedLoop, close
from cosim.models import Delay, DelaySystem, paper_example


def free(A: object, *terms: tuple[float, object]) -> DelaySystem:
    """x' = A x + sum A_i x(t-d_i), from (d_i, A_i)."""
    return DelaySystem(A, delays=[Delay(d, M) for d, M in terms])  # type: ignore[arg-type]


def margins(system: DelaySystem) -> tuple[float | None, ...]:
    return delay_margin(system, np.zeros((0, system.A.shape[0])))


@pytest.mark.parametrize("present", [0.0, 0.3, 1.5])
def test_integrator_margin_is_a_quarter_turn(present: float) -> None:
    """x' = -x(t-d) is stable exactly for d < pi/2, from whatever delay one looks."""
    assert margins(free([[0]], (present, [[-1]]))) == (pytest.approx(math.pi / 2, rel=1e-13),)


@pytest.mark.parametrize(("a", "b"), [(1, 2), (0, 3), (-1, 2), (1, 1.0001), (10, 10.5), (1e-3, 5)])
def test_scalar_margin(a: float, b: float) -> None:
    """x' = -a x - b x(t-d), b > |a|: arccos(-a/b) / sqrt(b^2 - a^2), however far away."""
    exact = math.acos(-a / b) / math.sqrt(b * b - a * a)
    assert margins(free([[-a]], (0, [[-b]]))) == (pytest.approx(exact, rel=1e-9),)


@pytest.mark.parametrize(("a", "b"), [(1, 0.9), (2, -1.5), (1, 1), (1, 0)])
def test_scalar_without_margin(a: float, b: float) -> None:
    """a >= |b|: stable for every delay; a = b, where |jw + a| = b only at w = 0, is the edge."""
    assert margins(free([[-a]], (0.5, [[-b]]))) == (None,)


@pytest.mark.parametrize("present", [0.0, 1.0, 6.17])
def test_published_benchmark(present: float) -> None:
    """The literature's two-state example: 6.172581371."""
    system = free([[-2, 0], [0, -0.9]], (present, [[-1, 0], [-1, -1]]))
    assert margins(system) == (pytest.approx(6.172581371, abs=1e-9),)


@pytest.mark.parametrize(("present", "touch"), [(0.0, 1), (3.0, 1), (4.0, 3)])
def test_roots_that_touch_the_axis_and_return(present: float, touch: int) -> None:
    """s^2 + s + 1 + s e^{-sd}: +-j at d = pi, 3 pi, ..., stable in between: lost at the touch."""
    system = free([[0, 1], [-1, -1]], (present, [[0, 0], [0, -1]]))
    assert spectral_abscissa(close(system, np.zeros((0, 2)))) < 0.0
    assert margins(system) == (pytest.approx(touch * math.pi, rel=1e-7),)


def test_loss_in_a_narrow_band() -> None:
    """x'' + 2z x' + x = -e x(t-d), z = 1e-4, e = 3e-4: |(jw)^2 + 2z jw + 1| = e at two w."""
    z, e = 1e-4, 3e-4
    squares = 1 - 2 * z**2 + np.array([-1, 1]) * math.sqrt((1 - 2 * z**2) ** 2 - (1 - e**2))
    w = np.sqrt(squares)
    turn = np.angle(-e / (1 - w**2 + 2j * z * w)) % (2 * math.pi)
    system = free([[0, 1], [-1, -2 * z]], (0, [[0, 0], [-e, 0]]))
    assert margins(system) == (pytest.approx((turn / w).min(), rel=1e-6),)


def test_two_delays_of_one_equation() -> None:
    """x' = -a x(t-d1) - a x(t-d2): 2a (d1+d2) cos(pi (d1-d2) / (2 (d1+d2))) < pi.

    Hale and Huang, J. Math. Anal. Appl. 178 (1993).
    """
    a = 1.0

    def edge(d1: float, d2: float) -> float:
        total = d1 + d2
        return 2 * a * total * math.cos(math.pi * (d1 - d2) / (2 * total)) - math.pi

    found = margins(free([[0]], (0.6, [[-a]]), (0.8, [[-a]])))
    first = brentq(lambda d: edge(d, 0.8), 0.6, 2.0, xtol=1e-14)
    second = brentq(lambda d: edge(0.6, d), 0.8, 5.0, xtol=1e-14)
    assert found == (pytest.approx(first, rel=1e-9), pytest.approx(second, rel=1e-9))
    # 2 a d1 < 1: stable for every d2, although |F| is only kept off zero by w > 0
    assert margins(free([[0]], (0.3, [[-a]]), (0.8, [[-a]])))[1] is None


def test_equal_delays_are_entries_of_their_own() -> None:
    """Two terms at one delay: each is moved alone, and not at all the same as both together."""
    system = free([[0]], (0.6, [[-1.1]]), (0.6, [[-1]]))
    first, second = margins(system)
    assert first is not None
    assert second is not None
    together = margins(free([[0]], (0.6, [[-2.1]])))[0]
    assert together == pytest.approx(math.pi / 4.2, rel=1e-12)
    assert together < first < second
    for k, margin in enumerate((first, second)):
        assert abs(moved(system, k)(margin)) < 1e-9


def test_delay_outside_every_cycle_has_no_margin() -> None:
    """A one-way coupling, and a matrix of zeros, may be as late as they like."""
    system = free(np.diag([-1.0, -2]), (1, [[0, 5], [0, 0]]), (0.2, np.zeros((2, 2))))
    assert margins(system) == (None, None)


@pytest.mark.parametrize(
    ("A", "Ad"), [([[0.1]], [[0]]), ([[0]], [[0]]), ([[0]], [[-math.pi / 2 - 1e-6]])]
)
def test_unstable_loop_has_no_margin(A: object, Ad: object) -> None:
    """None in every entry; the abscissa says why."""
    assert margins(free(A, (1.0, Ad), (2.0, [[0]]))) == (None, None)


def test_printed_gain_has_no_delay_margin() -> None:
    """Section 5 with the printed K is stable for every delay (max rho = 0.174)."""
    assert delay_margin(paper_example.system(), [paper_example.PRINTED_K]) == (None,)


def test_units_of_the_states_do_not_matter() -> None:
    """The benchmark with states in other units, six orders apart: the same delay."""
    T = np.diag([1e-3, 1e3])
    A, Ad = np.diag([-2, -0.9]), np.array([[-1, 0], [-1, -1]])
    system = free(T @ A @ np.linalg.inv(T), (1, T @ Ad @ np.linalg.inv(T)))
    assert margins(system) == (pytest.approx(6.172581371, abs=1e-8),)


@pytest.mark.slow
def test_vehicle_over_its_link() -> None:
    """Four axes, s^2 + a s e^{-s/2} + (p + q s) e^{-s tau}: the first to fail, in closed form."""
    a, gains = 0.05, [(0.075, 0.53), (0.072, 0.54), (0.047, 0.55), (0.052, 0.53)]
    shift = np.block([[np.zeros((4, 4)), np.eye(4)], [np.zeros((4, 8))]])
    damping = np.diag([0.0] * 4 + [-a] * 4)
    system = DelaySystem(
        shift,
        B=np.vstack([np.zeros((4, 4)), np.eye(4)]),
        delays=[Delay(0.5, damping), Delay(1.25, np.zeros((8, 8)), feedback=True)],
    )
    K = -np.hstack([np.diag([p for p, _ in gains]), np.diag([q for _, q in gains])])
    exact = []
    for p, q in gains:

        def ratio(w: float, p: float = p, q: float = q) -> complex:
            s = 1j * w
            return -(s * s + a * s * np.exp(-0.5 * s)) / (p + q * s)

        w = brentq(lambda w: abs(ratio(w)) - 1, 0.1, 2.0, xtol=1e-14)
        exact.append((-np.angle(ratio(w)) % (2 * math.pi)) / w)
    state, loop = delay_margin(system, K)
    assert loop == pytest.approx(min(exact), rel=1e-9)
    assert state is None
    for d in (2.0, 10.0, 40.0):
        assert spectral_abscissa(close(with_delay(system, 0, d), K)) < 0


def with_delay(system: DelaySystem, k: int, d: float) -> DelaySystem:
    delays = list(system.delays)
    delays[k] = replace(delays[k], d=d)
    return replace(system, delays=tuple(delays))


def moved(system: DelaySystem, k: int) -> Callable[[float], float]:
    """The spectral abscissa as a function of delay k."""
    A: Sequence[object] = [system.A, *(x.A for x in system.delays)]
    delays = [0.0, *(x.d for x in system.delays)]

    def abscissa(d: float) -> float:
        return spectral_abscissa(
            ClosedLoop(A, [*delays[: k + 1], d, *delays[k + 2 :]])  # type: ignore[arg-type]
        )

    return abscissa


@pytest.mark.parametrize("seed", sampled(range(12), 3))
def test_random_systems_against_their_roots(seed: int) -> None:
    """One to three delays, one to four states: stable up to the margin, and not beyond it."""
    rng = np.random.default_rng(seed)
    while True:
        n, N = int(rng.integers(1, 5)), int(rng.integers(1, 4))
        A = rng.normal(size=(n, n)) - 2 * np.eye(n)
        terms = [(float(d), rng.normal(size=(n, n))) for d in rng.uniform(0, 0.5, N)]
        system = free(A, *terms)
        if spectral_abscissa(close(system, np.zeros((0, n)))) < 0:
            break
    for k, margin in enumerate(margins(system)):
        abscissa, d = moved(system, k), terms[k][0]
        if margin is None:
            assert all(abscissa(d + more) < 0 for more in (0.1, 0.5, 1, 2, 5, 10))
        else:
            below = np.linspace(d, margin * (1 - 1e-6), 10)
            assert all(abscissa(float(value)) < 0 for value in below)
            assert abscissa(margin * (1 + 1e-6)) > 0


def test_wrong_gain_is_refused() -> None:
    """A gain that does not fit is an input error that names K."""
    with pytest.raises(InputError, match=r"^K: "):
        delay_margin(paper_example.system(), [[1.0, 2.0, 3.0]])
