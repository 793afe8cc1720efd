"""The H-infinity norm against closed forms, a Hamiltonian bisection and dense sweeps."""

import math

import numpy as np
import pytest
import scipy.linalg

from cosim.core import InputError
from cosim.hinf import hinf_norm
from cosim.hinf.delay_lti import ClosedLoop, NormResult, close, gain_at
from cosim.models import Delay, DelaySystem, paper_example


def norm_of(loop: ClosedLoop) -> NormResult:
    """The norm of a stable loop, its own claims checked."""
    result = hinf_norm(loop)
    assert result is not None
    assert result.value <= result.bound
    assert gain_at(loop, result.frequency) == pytest.approx(result.value, rel=1e-13)
    return result


def hamiltonian_norm(A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray) -> float:
    """Norm without delay: bisection on imaginary eigenvalues of the Hamiltonian (Boyd 1989)."""

    def crosses(gamma: float) -> bool:
        R = gamma**2 * np.eye(D.shape[1]) - D.T @ D
        F = A + B @ np.linalg.solve(R, D.T @ C)
        Q = -C.T @ (np.eye(D.shape[0]) + D @ np.linalg.solve(R, D.T)) @ C
        eigenvalues = scipy.linalg.eigvals(np.block([[F, B @ np.linalg.solve(R, B.T)], [Q, -F.T]]))
        return bool(np.any(np.abs(eigenvalues.real) < 1e-9 * np.abs(eigenvalues).max()))

    low, high = np.linalg.norm(D, 2) * (1 + 1e-12) + 1e-12, 1e6
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if crosses(middle) else (low, middle)
    return high


def resonance(zeta: float) -> ClosedLoop:
    """1 / (s^2 + 2 zeta s + 1)."""
    return ClosedLoop([[[0, 1], [-1, -2 * zeta]]], [0], [[0], [1]], [[[1, 0]]])


@pytest.mark.parametrize("zeta", [0.5, 0.1, 1e-2, 1e-3, 1e-4, 1e-6])
def test_resonance_peak(zeta: float) -> None:
    """The peak of a second-order resonance, 1/(2 zeta sqrt(1-zeta^2)), however narrow."""
    result = norm_of(resonance(zeta))
    assert result.value == pytest.approx(1 / (2 * zeta * math.sqrt(1 - zeta**2)), rel=1e-9)
    assert result.frequency == pytest.approx(math.sqrt(1 - 2 * zeta**2), rel=1e-6)
    assert result.bound <= result.value * (1 + 2e-9)


def test_narrow_peak_beside_a_broad_one() -> None:
    """Of two decoupled resonances the narrow higher one is found: broad at 1, narrow at 37."""
    A = scipy.linalg.block_diag([[0, 1], [-1, -0.2]], [[0, 37], [-37, -2 * 37 * 1e-4]])
    C, D = np.array([[0.0], [1], [0], [0.01]]), np.array([[1.0, 0, 0, 0], [0, 0, 1, 0]])
    exact = 0.01 / 37 / (2 * 1e-4 * math.sqrt(1 - 1e-8))
    broad = 1 / (0.2 * math.sqrt(1 - 0.01))
    assert norm_of(ClosedLoop([A], [0], C, [D])).value == pytest.approx(broad, rel=1e-6)
    C[3] = 1.0
    assert norm_of(ClosedLoop([A], [0], C, [D])).value == pytest.approx(100 * exact, rel=1e-6)


def test_printed_gain_of_the_example() -> None:
    """Section 5 with the printed K: 5.0276 at 22.9 rad/s (independently computed)."""
    result = norm_of(close(paper_example.system(), [paper_example.PRINTED_K]))
    assert result.value == pytest.approx(5.0276, abs=5e-5)
    assert result.frequency == pytest.approx(22.9, abs=5e-2)
    assert result.bound <= result.value * (1 + 2e-9)


@pytest.mark.parametrize("seed", range(6))
def test_without_delay_it_is_the_hamiltonian_norm(seed: int) -> None:
    """Random stable systems without delay agree with Hamiltonian bisection to 1e-7."""
    rng = np.random.default_rng(seed)
    n, q, p = 2 + seed, 1 + seed % 3, 1 + seed % 2
    A = rng.normal(size=(n, n))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(n)
    C, D, D1 = rng.normal(size=(n, q)), rng.normal(size=(p, n)), rng.normal(size=(p, q))
    result = norm_of(ClosedLoop([A], [0], C, [D], D1))
    assert result.value == pytest.approx(hamiltonian_norm(A, C, D, D1), rel=1e-7)


@pytest.mark.parametrize(("b", "d"), [(0.5, 1.0), (0.9, 3.0), (0.5, 40.0)])
def test_scalar_delay_has_its_peak_at_zero(b: float, d: float) -> None:
    """x' = -x + b x(t-d) + w, 0 < b < 1: |jw + 1 - b e^{-jwd}| is least at 0: norm 1/(1-b)."""
    result = norm_of(ClosedLoop([[[-1]], [[b]]], [0, d], [[1]], [[[1]], [[0]]]))
    assert result.value == pytest.approx(1 / (1 - b), rel=1e-12)
    assert result.frequency == pytest.approx(0, abs=1e-6)


def test_delayed_output_alone_has_the_norm_of_its_comb() -> None:
    """z = w - x(t-d) with x' = -x + w: |1 - e^{-jwd}/(1+jw)|, swept densely in closed form."""
    d = 7.0
    loop = ClosedLoop([[[-1]], [[0]]], [0, d], [[1]], [[[0]], [[-1]]], [[1]])
    w = np.linspace(0, 20, 4_000_001)
    exact = np.abs(1 - np.exp(-1j * w * d) / (1 + 1j * w)).max()
    assert norm_of(loop).value == pytest.approx(exact, rel=1e-9)
    np.testing.assert_allclose(
        gain_at(loop, w[:1000]), np.abs(1 - np.exp(-1j * w * d) / (1 + 1j * w))[:1000], rtol=1e-13
    )


def test_feedback_over_a_link() -> None:
    """Integrator, u = -k x(t-d), z = (x, u): sqrt(1+k^2)/|jw + k e^{-jwd}|, swept densely."""
    k, d = 1.0, 1.2
    system = DelaySystem(
        [[0]],
        B=[[1]],
        C=[[1]],
        D=[[1], [0]],
        D2=[[0], [1]],
        delays=[Delay(d, [[0]], feedback=True)],
    )
    w = np.linspace(0, 10, 2_000_001)
    exact = (math.sqrt(1 + k * k) / np.abs(1j * w + k * np.exp(-1j * w * d))).max()
    assert norm_of(close(system, [[-k]])).value == pytest.approx(exact, rel=1e-9)


def test_several_delays_against_a_dense_sweep() -> None:
    """Three incommensurate delays, two inputs and outputs: no sample of a dense sweep is higher."""
    rng = np.random.default_rng(7)
    n, delays = 4, [0.0, 0.37, 1.1, 2.3]
    A = [rng.normal(size=(n, n)) - 5 * np.eye(n), *(0.6 * rng.normal(size=(3, n, n)))]
    C, D = rng.normal(size=(n, 2)), list(rng.normal(size=(4, 2, n)))
    w = np.linspace(0, 60, 120_001)
    e = np.exp(-1j * w[:, None] * np.array(delays))
    H = 1j * w[:, None, None] * np.eye(n) - np.einsum("wi,ijk->wjk", e, np.array(A))
    G = np.einsum("wi,ijk->wjk", e, np.array(D)) @ np.linalg.inv(H) @ C
    top = np.linalg.svd(G, compute_uv=False)[:, 0].max()
    result = norm_of(ClosedLoop(A, delays, C, D))
    assert top <= result.bound
    assert result.value == pytest.approx(top, rel=1e-6)


def test_limit_at_infinity() -> None:
    """s/(s+1) = 1 - 1/(s+1) approaches 1 only as w -> infinity; the bound stays within 1e-8."""
    result = norm_of(ClosedLoop([[[-1]]], [0], [[1]], [[[-1]]], [[1]]))
    assert (result.value, result.frequency) == (1.0, math.inf)
    assert result.bound <= 1 + 1e-8


def test_zero_C_leaves_the_direct_term() -> None:
    """C = 0: the gain is |D1| at every frequency, and zero where D1 is zero too."""
    loop = ClosedLoop([[[-1]]], [0], [[0]], [[[1], [0]]], [[3], [4]])
    assert hinf_norm(loop) == (5.0, math.inf, 5.0)
    loop = ClosedLoop([np.diag([-1.0, -2])], [0], [[1], [0]], [[[0, 1]]])
    result = norm_of(loop)
    assert result.value < 1e-15
    assert result.bound < 1e-5


@pytest.mark.parametrize("a", [0.0, 0.1])
def test_loop_that_is_not_asymptotically_stable_has_none(a: float) -> None:
    """A root on or right of the axis, with a delay or without: there is no norm."""
    assert hinf_norm(ClosedLoop([[[a]]], [0], [[1]], [[[1]]])) is None
    loop = ClosedLoop([[[0]], [[-math.pi / 2 - a - 1e-9]]], [0, 1], [[1]], [[[1]], [[0]]])
    assert hinf_norm(loop) is None


def test_gain_without_performance_is_refused() -> None:
    """A loop without w or z has a stability, but no gain: an input error says so."""
    loop = ClosedLoop([[[-1]]], [0])
    for ask in (hinf_norm, lambda x: gain_at(x, 0.0)):
        with pytest.raises(InputError, match="no gain"):
            ask(loop)


def test_gain_keeps_the_shape_of_the_frequencies() -> None:
    """Frequencies of any shape, infinity included, give gains of that shape; 1/(s+1) + 2."""
    loop = ClosedLoop([[[-1]]], [0], [[1]], [[[1]]], [[2]])
    w = np.array([[0.0, 1.0], [3.0, np.inf]])
    with np.errstate(invalid="ignore"):
        exact = np.where(np.isinf(w), 2.0, np.abs(2 + 1 / (1 + 1j * w)))
    np.testing.assert_allclose(gain_at(loop, w), exact, rtol=1e-14)
    assert gain_at(loop, 0.0).shape == ()


@pytest.mark.slow
def test_vehicle_over_its_link() -> None:
    """The late-feedback vehicle: norm about 1.9, each axis in closed form; high gains have none."""
    n, state_delay, loop_delay = 8, 0.5, 1.25
    kinematics = np.block([[np.zeros((4, 4)), np.eye(4)], [np.zeros((4, 8))]])
    onto = np.vstack([np.zeros((4, 4)), np.eye(4)])
    D, D2 = 0.1 * np.eye(8, n), np.vstack([np.zeros((4, 4)), np.eye(4)])
    D[4:] = 0.0
    system = DelaySystem(
        kinematics,
        B=onto,
        C=onto,
        D=D,
        D2=D2,
        delays=[
            Delay(state_delay, np.diag([0.0] * 4 + [-0.05] * 4)),
            Delay(loop_delay, np.zeros((n, n)), feedback=True),
        ],
    )
    gentle = close(system, -np.hstack([0.06 * np.eye(4), 0.53 * np.eye(4)]))
    assert norm_of(gentle).value == pytest.approx(1.9, abs=0.06)
    # One axis alone, in closed form over a dense sweep: every axis is the same.
    s = 1j * np.linspace(0, 20, 400_001)
    late = np.exp(-1.25 * s) * (0.06 + 0.53 * s)
    H = s * (s + 0.05 * np.exp(-0.5 * s)) + late
    exact = np.sqrt((0.1**2 + np.abs(late) ** 2) / np.abs(H) ** 2).max()
    assert norm_of(gentle).value == pytest.approx(exact, rel=1e-8)
    assert hinf_norm(close(system, -np.hstack([0.22 * np.eye(4), 1.70 * np.eye(4)]))) is None
