"""Characteristic roots against closed forms, published numbers and a dense eigensolver."""

import itertools
import math

import numpy as np
import pytest
from scipy.special import lambertw

from cosim.core import InputError
from cosim.hinf import characteristic_roots, spectral_abscissa
from cosim.hinf.delay_lti import ClosedLoop, close, roots_right_of
from cosim.models import Delay, DelaySystem, paper_example


def benchmark(d: float) -> ClosedLoop:
    """The two-state benchmark of the delay literature, greatest delay 6.172581371."""
    return ClosedLoop([[[-2, 0], [0, -0.9]], [[-1, 0], [-1, -1]]], [0, d])


def scalar(a: float, b: float, d: float) -> ClosedLoop:
    """x' = a x + b x(t-d)."""
    return ClosedLoop([[[a]], [[b]]], [0, d])


def branches(b: float, d: float, a: float = 0.0) -> np.ndarray:
    """Exact roots of s = a + b e^{-s d}: a + W_k(b d e^{-a d}) / d, rightmost first."""
    w = np.array([lambertw(b * d * math.exp(-a * d), k) for k in range(-40, 41)])
    roots = a + w / d
    return roots[np.argsort(-roots.real, kind="stable")]


@pytest.mark.parametrize(("a", "b", "d"), [(0, -1, 1), (-1, -2, 0.7), (0.3, -1, 1), (-1, 0.5, 5)])
def test_scalar_roots_are_branches_of_lambert_w(a: float, b: float, d: float) -> None:
    """The twenty rightmost roots of a scalar equation are those of Lambert's W, to 1e-10."""
    found = characteristic_roots(scalar(a, b, d), 20)
    exact = branches(b, d, a)[: found.size]
    np.testing.assert_allclose(found.real, exact.real, atol=1e-10, rtol=0)
    np.testing.assert_allclose(np.sort(found.imag), np.sort(exact.imag), atol=1e-10, rtol=0)


def test_double_root_is_found_once() -> None:
    """x' = -x(t-1)/e has the double root -1 (Lambert W's branch point): listed once."""
    found = characteristic_roots(scalar(0, -math.exp(-1), 1), 5)
    assert found[0].imag == 0.0
    assert abs(found[0] + 1) < 1e-7
    assert found[1].real < -3


def test_semisimple_root_is_found_once_and_counted_twice() -> None:
    """Two equal decoupled equations have every root twice: one entry each, count 4 not 2."""
    loop = ClosedLoop([np.zeros((2, 2)), -np.eye(2)], [0, 1])
    found = characteristic_roots(loop, 2)
    exact = branches(-1, 1)[:2]
    np.testing.assert_allclose(found, exact[np.argsort(-exact.imag)], atol=1e-10)
    assert roots_right_of(loop, -1.0) == 4


def test_benchmark_roots_at_unit_delay() -> None:
    """Published rightmost pair at d = 1: -0.57774454 +- 1.75263447j."""
    found = characteristic_roots(benchmark(1.0), 2)
    expected = [-0.57774454 + 1.75263447j, -0.57774454 - 1.75263447j]
    np.testing.assert_allclose(found, expected, atol=5e-9)


def test_benchmark_abscissa_changes_sign_at_the_published_delay() -> None:
    """The exact greatest delay 6.172581371 (published) separates stable from unstable."""
    assert spectral_abscissa(benchmark(6.172581371 - 1e-6)) < 0
    assert spectral_abscissa(benchmark(6.172581371 + 1e-6)) > 0


@pytest.mark.parametrize("d", [7.0, 20.0, 100.0])
def test_benchmark_follows_its_triangular_factors(d: float) -> None:
    """The benchmark is block triangular: its roots are those of its two scalar equations."""
    exact = max(branches(-1, d, -2)[0].real, branches(-1, d, -0.9)[0].real)
    assert spectral_abscissa(benchmark(d)) == pytest.approx(exact, abs=1e-11)


def test_printed_gain_of_the_example() -> None:
    """Section 5 with the printed K: -5.138 and -5.878 +- 5.274j (independently computed)."""
    found = characteristic_roots(close(paper_example.system(), [paper_example.PRINTED_K]), 3)
    np.testing.assert_allclose(found, [-5.138, -5.878 + 5.274j, -5.878 - 5.274j], atol=5e-4)


@pytest.mark.parametrize("d", [0.01, 1.0, 10.0, 100.0, 1000.0])
def test_example_is_stable_for_every_delay(d: float) -> None:
    """max over w of rho((jwI - A_K)^-1 A1) = 0.174 < 1: that loop is stable however long d is."""
    loop = close(paper_example.system(d), [paper_example.PRINTED_K])
    w = np.linspace(0, 100, 4001)
    S = np.linalg.inv(1j * w[:, None, None] * np.eye(2) - loop.A[0])
    assert np.abs(np.linalg.eigvals(S @ loop.A[1])).max() < 0.18
    assert spectral_abscissa(loop) < 0


@pytest.mark.parametrize("n", [1, 3, 8])
def test_without_delay_they_are_eigenvalues(n: int) -> None:
    """No delay, or a delay without a matrix: the roots are numpy's eigenvalues, all n of them."""
    A = np.random.default_rng(n).normal(size=(n, n))
    exact = np.sort_complex(np.linalg.eigvals(A))
    for loop in (ClosedLoop([A], [0]), ClosedLoop([A, np.zeros((n, n))], [0, 2])):
        found = np.sort_complex(characteristic_roots(loop, n))
        np.testing.assert_allclose(found, exact, atol=1e-10)
    assert characteristic_roots(ClosedLoop([A], [0]), 100).size == n


def test_delay_outside_every_cycle_leaves_the_eigenvalues() -> None:
    """A delayed one-way coupling adds no roots: they stay -1 and -2, and no more are claimed."""
    loop = ClosedLoop([np.diag([-1.0, -2.0]), [[0, 1], [0, 0]]], [0, 1])
    np.testing.assert_allclose(characteristic_roots(loop, 6), [-1, -2], atol=1e-12)


def test_roots_next_to_a_fast_mode_stay_apart() -> None:
    """A mode at -1e6 does not blur slow ones: each slow root is its scalar equation's."""
    loop = ClosedLoop([np.diag([-1e6, -1, -1.5]), np.diag([0, 0.5, 0.4])], [0, 1])
    exact = sorted([branches(0.5, 1, -1)[0].real, branches(0.4, 1, -1.5)[0].real], reverse=True)
    np.testing.assert_allclose(characteristic_roots(loop, 2), exact, atol=1e-9)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_units_of_the_states_do_not_matter(far: float) -> None:
    """The benchmark in units that lie far apart has the same roots, to 1e-10."""
    T = np.diag([1.0, far])
    loop = benchmark(1.0)
    turned = ClosedLoop([T @ A @ np.linalg.inv(T) for A in loop.A], loop.delays)
    exact = characteristic_roots(loop, 6)
    np.testing.assert_allclose(characteristic_roots(turned, 6), exact, atol=1e-10)


def test_close_roots_of_a_long_delay() -> None:
    """Weakly coupled, 16 s late: many roots near the axis; the first few by a hand's Newton."""
    A, B = [[-3.4, -0.8], [0.8, -2.4]], [[0, 0.35], [0, 0]]
    C, d = [[-0.07, -0.6], [-0.07, 0.4]], [0.01, 16.2]
    loop = ClosedLoop([A, C, B], [0, *d])
    found = characteristic_roots(loop, 5)

    def f(s: complex) -> complex:
        c, b = np.exp(-s * d[0]), np.exp(-s * d[1])
        return (s + 3.4 + 0.07 * c) * (s + 2.4 - 0.4 * c) - (-0.8 - 0.6 * c + 0.35 * b) * (
            0.8 - 0.07 * c
        )

    for s in found:
        assert abs(f(s) / ((f(s + 1e-6) - f(s - 1e-6)) / 2e-6)) < 1e-9
    assert roots_right_of(loop, found[0].real + 1e-6) == 0


def test_three_delays_against_a_separate_newton() -> None:
    """Three incommensurate delays: det H, expanded by hand, vanishes at every root; none missed."""
    a, b, c, d = -0.5, -1.1, 0.7, -0.4
    loop = ClosedLoop(
        [[[a, 1], [0, -1]], [[0, 0], [b, 0]], [[0, 0], [0, c]], [[d, 0], [0, 0]]], [0, 0.4, 1.3, 2]
    )
    found = characteristic_roots(loop, 12)

    def f(s: complex) -> complex:
        e = np.exp
        return (s - a - d * e(-2 * s)) * (s + 1 - c * e(-1.3 * s)) - b * e(-0.4 * s)

    for s in found:
        slope = (f(s + 1e-6) - f(s - 1e-6)) / 2e-6
        assert abs(f(s) / slope) < 1e-9
    # Counted anew by the phase of f around a rectangle right of the last root but none beyond.
    x, y = found[-1].real - 1e-3, 60.0
    corners = [x - 1j * y, y - 1j * y, y + 1j * y, x + 1j * y, x - 1j * y]
    path = np.concatenate([np.linspace(p, q, 400_001) for p, q in itertools.pairwise(corners)])
    turns = np.angle(f(path)[1:] / f(path)[:-1]).sum() / (2 * np.pi)
    assert round(turns) == found.size


def test_feedback_over_a_link_acts_late() -> None:
    """Integrator with u = -k x(t-d): s = -k e^{-s d}, stable exactly for k d < pi/2."""
    for k, stable in ((math.pi / 2 - 1e-6, True), (math.pi / 2 + 1e-6, False)):
        system = DelaySystem([[0]], B=[[1]], delays=[Delay(1.0, [[0]], feedback=True)])
        loop = close(system, [[-k]])
        assert (spectral_abscissa(loop) < 0) is stable


def test_touching_the_axis_is_seen() -> None:
    """A=[0 1;-1 -1], Ad=[0 0;0 -1]: at d = pi the roots +-j touch the axis; closed form."""
    loop = ClosedLoop([[[0, 1], [-1, -1]], [[0, 0], [0, -1]]], [0, math.pi])
    assert spectral_abscissa(loop) == pytest.approx(0, abs=1e-9)
    assert spectral_abscissa(ClosedLoop(loop.A, [0, math.pi - 0.3])) < -1e-3


def test_equal_delays_are_merged() -> None:
    """Terms with the same delay, zero included, add up."""
    loop = ClosedLoop([[[1]], [[2]], [[4]], [[8]]], [0.5, 0, 0.5, 0])
    assert loop.delays == (0.0, 0.5)
    assert [A.item() for A in loop.A] == [10, 5]


def test_close_puts_every_matrix_where_the_equations_say() -> None:
    """Feedback over a delay: A1 + B K on the late state, D2 K in z on the late state."""
    system = DelaySystem(
        [[1]],
        B=[[2]],
        C=[[3]],
        D=[[5]],
        D1=[[7]],
        D2=[[11]],
        delays=[Delay(0.1, [[13]]), Delay(0.2, [[17]], feedback=True)],
    )
    loop = close(system, [[19]])
    assert loop.C is not None
    assert loop.D1 is not None
    assert [A.item() for A in loop.A] == [1, 13, 17 + 2 * 19]
    assert [D.item() for D in loop.D] == [5, 0, 11 * 19]
    assert (loop.C.item(), loop.D1.item()) == (3, 7)


@pytest.mark.parametrize("K", [[[1, 2, 3]], [[1], [2]], [1, 2], [["a", "b"]], [[math.nan, 0]]])
def test_wrong_gain_is_refused(K: object) -> None:
    """A gain of the wrong shape or without numbers is an input error that names K."""
    with pytest.raises(InputError, match=r"^K: "):
        close(paper_example.system(), K)  # type: ignore[arg-type]


def test_wrong_loops_are_refused() -> None:
    """Mismatched matrices, a negative delay and an empty request are input errors."""
    with pytest.raises(InputError, match=r"A\[1\]"):
        ClosedLoop([[[1]], [[1, 2]]], [0, 1])
    with pytest.raises(InputError, match=r"delays\[1\]"):
        ClosedLoop([[[1]], [[1]]], [0, -1])
    with pytest.raises(InputError, match="one matrix A per delay"):
        ClosedLoop([[[1]]], [0, 1])
    with pytest.raises(InputError, match="count"):
        characteristic_roots(ClosedLoop([[[1]]], [0]), 0)
