"""The exact certificate: what it proves, what it refuses, and that what it proves is true.

The truths from outside: published delay bounds, |D1|, frequency sweeps, the rightmost roots of
the delay equation, the exact map of a sampled loop.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy.linalg import expm
from shared import sampled
from solver_points import Array, Point, benchmark, random_system, solved

from cosim.core import InputError
from cosim.hinf import check_certificate
from cosim.models import Delay, DelaySystem, paper_example


@pytest.fixture(scope="module")
def paper() -> tuple[DelaySystem, Array, Point]:
    """Section 5 at gamma = 5.05, k1 = 0.6, k2 = 0.2."""
    system = paper_example.system()
    status, K, variables = solved(system, (0.6,), (0.2,), 5.05)
    assert status == "optimal"
    return system, K, variables


def test_the_papers_example_is_proved_at_gamma_5_05(
    paper: tuple[DelaySystem, Array, Point],
) -> None:
    """Feasible at 5.05 (the least gamma of the LMI at these k1, k2 is 5.0132)."""
    system, K, v = paper
    certificate = v.certify(system, K)
    assert certificate.valid
    assert certificate.reason is None
    assert certificate.claim["inputs"] == "doubles"
    assert Fraction(certificate.claim["gamma"]) == Fraction(5.05)


@pytest.mark.parametrize("gamma", [4.0, 4.99, 5.0])
def test_no_gamma_up_to_the_norm_of_D1_is_ever_proved(
    paper: tuple[DelaySystem, Array, Point], gamma: float
) -> None:
    """|D1| = |[4; 3]| = 5 bounds every gain from below, whatever the variables."""
    system, K, v = paper
    assert not v.changed(gamma=gamma).certify(system, K).valid
    _, other, solution = solved(system, (0.6,), (0.2,), gamma)
    assert not solution.certify(system, other).valid


def test_proof_uses_the_rounded_gain() -> None:
    """Near the least gamma, K to three digits with the same X is not proved, and K itself is."""
    system = paper_example.system()
    _, K, v = solved(system, (0.6,), (0.2,), 5.0135)
    assert v.certify(system, K).valid
    rounded = v.certify(system, np.round(K, 3))
    assert not rounded.valid
    assert rounded.reason is not None
    assert "-Omega" in rounded.reason


@pytest.mark.parametrize("d", [0.0, 1e-6, 1.0, 2.0, 3.0])
def test_stability_alone_is_proved_below_the_delay_bound(d: float) -> None:
    """The benchmark is stable at these delays; the claim speaks of no gain."""
    status, K, v = solved(benchmark(d), (0.0,), (0.2,), None)
    certificate = v.certify(benchmark(d), K)
    assert status == "optimal"
    assert certificate.valid, certificate.reason
    assert certificate.claim["property"] == "stability"
    assert check_certificate(v.document(benchmark(d), K)) == certificate


@pytest.mark.parametrize("d", [6.2, 6.5, 20.0])
@pytest.mark.parametrize("k", [(0.0, 0.2), (-0.1, 0.3), (-0.05, 0.05)])
def test_a_solvers_optimal_at_an_unstable_delay_is_refused(
    d: float, k: tuple[float, float]
) -> None:
    """Beyond 6.1726 the loop is unstable; the solver says optimal and nothing is proved."""
    status, K, v = solved(benchmark(d), (k[0],), (k[1],), None)
    assert status == "optimal"
    certificate = v.certify(benchmark(d), K)
    assert not certificate.valid
    assert certificate.reason


def test_conditions_beside_omega_are_checked(paper: tuple[DelaySystem, Array, Point]) -> None:
    """k2 = 0, an indefinite Q or X, and a Q where any age is claimed are each named."""
    system, K, v = paper
    delay = system.delays[0]
    old = Delay(delay.d, delay.A, delay.H, any_age=True)
    any_age = DelaySystem(
        system.A, system.B, system.C, system.D, system.D1, system.D2, system.E, system.H, [old]
    )
    for reason, other, changed in (
        ("k2[0] is 0", system, replace(v, k2=(0.0,))),
        ("X is not positive", system, v.changed(X=-v.unknowns["X"])),
        ("Q[0] is not positive", system, v.changed(Q_0=0 * v.unknowns["Q[0]"])),
        ("Q[0] is not exactly 0", any_age, v),
        ("-Omega", system, v.changed(R_0=-v.unknowns["R[0]"])),
        ("-Omega", system, v.changed(**{"eps[0]": -1.0})),
        ("-Omega", system, v.changed(gamma=-5.05)),
    ):
        certificate = changed.certify(other, K)
        assert not certificate.valid
        assert reason in str(certificate.reason)


def test_at_delay_zero_R_must_still_be_positive() -> None:
    """At d = 0 the rows of R vanish from the LMI; its sign is asked for all the same."""
    _, K, v = solved(benchmark(0.0), (0.0,), (0.2,), None)
    certificate = v.changed(R_0=-v.unknowns["R[0]"]).certify(benchmark(0.0), K)
    assert certificate.reason == "R[0] is not positive definite"


def test_shapes_that_do_not_fit_are_errors(paper: tuple[DelaySystem, Array, Point]) -> None:
    """A wrong shape or a NaN is bad input, not a failed proof."""
    system, K, v = paper
    for gain, changed in (
        (K.T, v),
        (K * np.nan, v),
        (K, v.changed(X=np.eye(3))),
        (K, v.changed(R_0=None)),
        (K, replace(v, k1=(np.inf,))),
        (K, v.changed(**{"eps[0]": None})),
        (K, v.changed(Q_0=v.unknowns["Q[0]"] * np.nan)),
    ):
        with pytest.raises(InputError):
            changed.certify(system, gain)


def test_any_age_covers_a_sampled_link_with_zero_order_hold() -> None:
    """A gain proved for any age up to d is stable sampled every h and sent with delay d - h.

    The truth is the exact map from one sample to the next: a message in the air for tau < h
    and held for h has an age between tau and tau + h = d.
    """
    A, B, d = np.array([[0.0, 1.0], [0.5, -0.2]]), np.array([[0.0], [1.0]]), 0.5
    link = Delay(d, np.zeros((2, 2)), feedback=True, any_age=True)
    system = DelaySystem(A, B, delays=[link])
    _, K, v = solved(system, (-1.0,), (1.0,), None)
    certificate = v.certify(system, K)
    assert certificate.valid, certificate.reason
    assert "any" in certificate.claim["delays"][0]["age"]

    def over(time: float) -> tuple[Array, Array]:
        """e^(A time) and the integral of e^(A s) B K over it."""
        whole = expm(time * np.block([[A, B @ K], [np.zeros((2, 4))]]))
        return whole[:2, :2], whole[:2, 2:]

    for h in (d, 0.9 * d, 0.7 * d, 0.51 * d):
        tau = d - h
        (_, old), (late, new), (whole, _) = over(tau), over(h - tau), over(h)
        step = np.block([[whole + new, late @ old], [np.eye(2), np.zeros((2, 2))]])
        assert np.abs(np.linalg.eigvals(step)).max() < 1


def _gain_and_abscissa(
    system: DelaySystem, K: Array, F: Array, ages: list[float]
) -> tuple[float, float]:
    """Greatest singular value of the loop's transfer function, and its rightmost root's real part.

    The norm by a dense sweep; the root from the generator's discretisation on Chebyshev points
    (Breda, Maset, Vermiglio 2005).
    """
    delayed = zip(system.delays, ages, strict=True)
    terms = [(0.0, system.A, system.H, system.immediate_feedback)]
    terms += [(age, x.A, x.H, x.feedback) for x, age in delayed]
    loop = [
        (age, A + system.E @ F @ H + (system.B @ K if acts else 0.0), acts)
        for age, A, H, acts in terms
    ]
    n, worst = len(system.A), float(np.linalg.norm(system.D1, 2))
    for frequency in np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 1500)]):
        s = 1j * frequency
        kernel = sum(A * np.exp(-s * age) for age, A, _ in loop)
        out = sum(system.D2 @ K * np.exp(-s * age) for age, _, acts in loop if acts)
        state = np.linalg.solve(s * np.eye(n) - kernel, system.C)
        worst = max(worst, float(np.linalg.norm((system.D + out) @ state + system.D1, 2)))
    points, longest = 20, max(ages)
    c = np.cos(np.pi * np.arange(points + 1) / points)
    weights = np.r_[2, np.ones(points - 1), 2] * (-1.0) ** np.arange(points + 1)
    gaps = c[:, None] - c[None, :] + np.eye(points + 1)
    derivative = np.outer(weights, 1 / weights) / gaps
    derivative -= np.diag(derivative.sum(axis=1))
    generator = np.kron(2 / longest * derivative, np.eye(n))
    generator[:n] = 0
    for age, A, _ in loop:
        at = 1 - 2 * age / longest
        basis = np.array(
            [
                np.prod([(at - c[k]) / (c[i] - c[k]) for k in range(points + 1) if k != i])
                for i in range(points + 1)
            ]
        )
        generator[:n] += np.kron(basis, A)
    return worst, float(np.linalg.eigvals(generator).real.max())


@pytest.mark.parametrize("seed", sampled([2, 3, 4], 1))
def test_what_is_proved_is_true_of_random_loops(seed: int) -> None:
    """Proved loops are stable with a norm below gamma, for random F and delays up to d."""
    rng = np.random.default_rng(seed)
    proved = 0
    for trial in range(8):
        system = random_system(
            rng, late=bool(trial % 2), any_age=bool(trial // 2 % 2), uncertain=True, scale=0.4
        )
        gamma = float(np.linalg.norm(system.D1, 2)) + float(rng.uniform(0.3, 3.0))
        k = (0.3 / system.delays[0].d, 0.3 / system.delays[1].d)
        _, K, v = solved(system, (-k[0], -k[1]), k, gamma)
        if not v.certify(system, K).valid:
            continue
        proved += 1
        for share in (1.0, 1.0, 0.6, 0.1):
            F = rng.standard_normal((3, 2))
            F /= np.linalg.norm(F, 2)
            norm, abscissa = _gain_and_abscissa(
                system, K, F, [share * delay.d for delay in system.delays]
            )
            assert norm <= gamma
            assert abscissa < 0
    assert proved >= 2
