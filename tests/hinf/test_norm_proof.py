"""The proved bound of the norm: above the truth it is proved, below it never."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from shared import sampled

from cosim.core import InputError
from cosim.hinf import auv_system, hinf_norm, spectral_abscissa
from cosim.hinf.certificate import NormProof
from cosim.hinf.delay_lti import close, gain_at, norm_proved
from cosim.models import Delay, DelaySystem, paper_example

CLOSE = 1e-8


def free(
    A: object, *terms: tuple[float, object], C: object, D: object, D1: object = None
) -> tuple[DelaySystem, np.ndarray]:
    """x' = A x + sum A_i x(t-d_i) + C w, z = D x + D1 w, and its gain of no rows."""
    system = DelaySystem(A, C=C, D=D, D1=D1, delays=[Delay(d, M) for d, M in terms])  # type: ignore[arg-type]
    return system, np.zeros((0, system.A.shape[0]))


@pytest.mark.parametrize("zeta", [0.5, 0.1, 1e-3, 1e-6])
def test_resonance(zeta: float) -> None:
    """1/(s^2 + 2 zeta s + 1), peak 1/(2 zeta sqrt(1-zeta^2)): just above and just below."""
    loop = free([[0, 1], [-1, -2 * zeta]], C=[[0], [1]], D=[[1, 0]])
    norm = 1 / (2 * zeta * math.sqrt(1 - zeta**2))
    assert norm_proved(*loop, norm * (1 + CLOSE))
    assert not norm_proved(*loop, norm * (1 - CLOSE))


@pytest.mark.parametrize("side", [-1, 1])
def test_an_interval_is_covered_up_to_both_ends(side: int) -> None:
    """About a point on a flank, below the level; at one end, nearer to the peak, above it."""
    loop = free([[0, 1], [-1, -0.2]], C=[[0], [1]], D=[[1, 0]])
    level = gain_at(close(*loop), 1 + side * 0.02)
    proof = NormProof(*loop, float(level))
    point = proof.point(1 + side * 0.03)
    assert proof.covers(point, 0.005)
    assert not proof.covers(point, 0.0101)


def test_an_interval_is_covered_where_the_phase_is_bounded() -> None:
    """Whatever the level: no longer than rho = h L1 |S| allows, with sqrt(2) asin(rho) < pi/2."""
    loop = free([[0, 1], [-1, -0.2]], C=[[0], [1]], D=[[1, 0]])
    proof = NormProof(*loop, 1e12)
    point = proof.point(0.5)
    longest = 0.999 * math.sin(math.pi / 2 / math.sqrt(2)) / float(proof.L1 * point.sizes[0])
    assert proof.covers(point, 0.999 * longest)
    assert not proof.covers(point, 1.001 * longest)


@pytest.mark.parametrize(("b", "d"), [(0.5, 1.0), (0.9, 3.0), (0.5, 40.0)])
def test_delay_with_its_peak_at_zero(b: float, d: float) -> None:
    """x' = -x + b x(t-d) + w: 1/(1-b), attained at w = 0."""
    loop = free([[-1]], (d, [[b]]), C=[[1]], D=[[1]])
    assert norm_proved(*loop, (1 + CLOSE) / (1 - b))
    assert not norm_proved(*loop, (1 - CLOSE) / (1 - b))


def test_gain_attained_at_infinite_frequency_only() -> None:
    """s/(s+1): 1 in the limit, by the closed form beyond the last interval."""
    loop = free([[-1]], C=[[1]], D=[[-1]], D1=[[1]])
    assert norm_proved(*loop, 1 + CLOSE)
    assert not norm_proved(*loop, 1.0)
    assert not norm_proved(*loop, 1 - CLOSE)


def test_matrices_of_gains() -> None:
    """diag(3/(s+1), 2/(s+1)), turned by rotations on either side: norm 3, Frobenius sqrt(13)."""
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    loop = free(-np.eye(2), C=turn, D=turn @ np.diag([3.0, 2.0]))
    assert norm_proved(*loop, 3 * (1 + CLOSE))
    assert not norm_proved(*loop, 3 * (1 - CLOSE))
    # as many outputs as fit on either side of the product
    wide = free(-np.eye(2), C=turn, D=(turn @ np.diag([3.0, 2.0]))[:1])
    row = float(np.linalg.norm((turn @ np.diag([3.0, 2.0]))[0]))
    assert norm_proved(*wide, row * (1 + CLOSE))
    assert not norm_proved(*wide, row * (1 - CLOSE))


def test_the_gain_is_taken_as_its_doubles() -> None:
    """x' = (a + b k) x with a = -fl(b k): zero in doubles, but truly stable, and only just."""
    pairs = ((1 + i / 1000, 0.1 + i / 777) for i in range(100))
    b, k = next((b, k) for b, k in pairs if Fraction(b) * Fraction(k) < Fraction(b * k))
    rate = Fraction(b * k) - Fraction(b) * Fraction(k)
    system = DelaySystem([[-b * k]], B=[[b]], C=[[float(rate)]], D=[[1.0]], D2=[[0.0]])
    assert close(system, [[k]]).A[0] == 0.0
    assert norm_proved(system, [[k]], 1 + CLOSE)
    assert not norm_proved(system, [[k]], 1 - CLOSE)


@pytest.mark.parametrize(
    "loop",
    [
        free([[1]], C=[[1]], D=[[1]]),
        free([[0]], C=[[1]], D=[[1]]),
        free([[0, 1], [-1, 0]], C=[[0], [1]], D=[[1, 0]]),
        free([[1e-3, 10], [-10, 1e-3]], C=[[1], [0]], D=[[0, 1]]),
        free([[0]], (1, [[-math.pi / 2 - 1e-3]]), C=[[1]], D=[[1]]),
        free([[0]], (1, [[-20]]), C=[[1]], D=[[1]]),
        free(np.diag([-1.0, 1]), C=[[1], [0]], D=[[1, 0]]),
        free(np.diag([-1.0, 1, 2]), C=[[1], [0], [0]], D=[[1, 0, 0]]),
    ],
)
def test_a_loop_that_is_not_stable_is_never_proved(loop: tuple[DelaySystem, np.ndarray]) -> None:
    """However small its gain on the axis, and although w or z may not see the root."""
    for level in (1.1, 10, 1e3, 1e6):
        assert not norm_proved(*loop, level)


def test_a_loop_that_is_only_just_stable_is_proved() -> None:
    """The counterparts of what is not stable: the count of roots is sharp."""
    assert norm_proved(*free([[-1e-3, 10], [-10, -1e-3]], C=[[1], [0]], D=[[0, 1]]), 501)
    assert norm_proved(*free([[0]], (1, [[-math.pi / 2 + 1e-3]]), C=[[1]], D=[[1]]), 1e4)


def random_loop(rng: np.random.Generator) -> tuple[DelaySystem, np.ndarray]:
    n, N = int(rng.integers(1, 7)), int(rng.integers(0, 4))
    p, q, m = rng.integers(1, 4, 3)
    late = int(rng.integers(0, N + 1))
    system = DelaySystem(
        rng.normal(size=(n, n)) - rng.uniform(0, 3) * np.eye(n),
        B=rng.normal(size=(n, m)),
        C=rng.normal(size=(n, q)),
        D=rng.normal(size=(p, n)),
        D1=rng.choice([0.0, 1.0]) * rng.normal(size=(p, q)),
        D2=rng.normal(size=(p, m)),
        delays=[
            Delay(
                float(rng.choice([0, 0.3, rng.uniform(0, 2)])),
                rng.normal(size=(n, n)) / math.sqrt(n),
                feedback=k + 1 == late,
            )
            for k in range(N)
        ],
    )
    return system, 0.3 * rng.normal(size=(m, n))


@pytest.mark.parametrize("seed", sampled(range(40), 20))
def test_random_loops(seed: int) -> None:
    """Stable: proved above the norm, never below. Not stable: never, above every gain there is."""
    system, K = random_loop(np.random.default_rng(seed))
    loop = close(system, K)
    if spectral_abscissa(loop) >= 0:
        top = float(gain_at(loop, np.linspace(0, 50, 2000)).max())
        assert not any(norm_proved(system, K, top * factor) for factor in (1.01, 10, 1e3))
        return
    norm = hinf_norm(loop)
    assert norm is not None
    # where the gain is flat at infinity, up close takes too long
    assert norm_proved(system, K, norm.value * (1 + (CLOSE if norm.frequency < 1e9 else 1e-2)))
    for factor in (1 - 1e-9, 0.9):
        assert not norm_proved(system, K, norm.value * factor)


def test_section_5_and_the_vehicle() -> None:
    """The printed gain, 5.0276; eight states and two delays, at the gains of the design."""
    paper, K = paper_example.system(), [paper_example.PRINTED_K]
    assert norm_proved(paper, K, 5.0276)
    assert not norm_proved(paper, K, 5.02758)
    auv = auv_system()
    K = -np.hstack([0.06 * np.eye(4), 0.53 * np.eye(4)])
    norm = hinf_norm(close(auv, K))
    assert norm is not None
    assert norm_proved(auv, K, norm.value * (1 + CLOSE))
    assert not norm_proved(auv, K, norm.value * (1 - CLOSE))
    assert not norm_proved(auv, 3 * K, 1e6)


def test_zero_C_leaves_the_direct_term_as_bound() -> None:
    """C = 0: |D1| = 5 at every frequency."""
    loop = free([[-1]], C=[[0]], D=[[1], [0]], D1=[[3], [4]])
    assert norm_proved(*loop, 5 * (1 + CLOSE))
    assert not norm_proved(*loop, 5.0)


def test_invalid_arguments_are_refused() -> None:
    """No w or z, no number, a gain of another shape."""
    system, K = free([[-1]], C=[[1]], D=[[1]])
    for level in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(InputError, match="level"):
            norm_proved(system, K, level)
    with pytest.raises(InputError, match="no gain"):
        norm_proved(DelaySystem([[-1]]), K, 1.0)
    with pytest.raises(InputError, match=r"K: wrong shape"):
        norm_proved(system, [[1.0]], 1.0)
