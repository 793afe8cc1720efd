"""No certified gamma is below the exact norm, no certified delay beyond the exact margin.

Two hundred random stable systems of two to six states, with one or two delays; some with w and
z, some uncertain, some with a delay of any age, some fed back over a delay. What is claimed of
them, by analysis of orders 0 to 2 (the higher ones for the smaller systems), by greatest delays
of four in five, by designs and their greatest delays of every third, is held against the truth
that `truth_of_loops` computes by its own means. The systems are drawn close to their margins,
where claims are tight; what a claim may exceed the truth by is rounding, 1e-9.
"""

from __future__ import annotations

from collections import Counter
from contextlib import suppress
from typing import Any, Literal

import numpy as np
import pytest
from shared import share_of
from truth_of_loops import (
    Array,
    abscissa,
    attained_gain,
    first_loss,
    first_loss_by_pencil,
    loop_of,
    norm,
)

from cosim.core import NotAchievableError
from cosim.hinf import analyse, certified_delay, design, greatest_delay, hinf_norm
from cosim.hinf.delay_lti import close
from cosim.hinf.problem import with_delays
from cosim.models import Delay, DelaySystem

_ROUNDING = 1e-9
_SHARES = (0.0, 0.35, 0.8)
"""Where a claim that covers every smaller delay is looked at, besides its end."""


class BeyondTruthError(AssertionError):
    """A claim that the truth contradicts."""


def random_stable(seed: int) -> DelaySystem:
    """n = 2 to 6; stable without and with its delays, the first of them close to the margin."""
    rng = np.random.default_rng(seed)
    n, N = 2 + seed % 5, 1 + (seed // 5) % 2
    performance, uncertain = seed % 4 != 3, seed % 3 == 1
    any_age, late = rng.random() < 0.25, rng.random() < 0.4

    def r(*shape: int, scale: float = 1.0) -> Array:
        return scale * rng.standard_normal(shape)

    finite = rng.random() < 0.85
    while True:
        A = r(n, n) - rng.uniform(0.3, 1.0) * np.sqrt(n) * np.eye(n)
        matrices = [r(n, n, scale=rng.uniform(0.3, 1.0)) for _ in range(N)]
        matrices[0] -= rng.uniform(0, 1) * np.sqrt(n) * np.eye(n)
        lengths = [0.0, *rng.uniform(0.05, 0.5, N - 1)]
        H = [r(2, n, scale=0.1) if uncertain else None for _ in range(N + 1)]
        delays = [
            Delay(d, M, h, any_age=any_age and j == N - 1)
            for j, (d, M, h) in enumerate(zip(lengths, matrices, H[1:], strict=True))
        ]
        system = DelaySystem(A, delays=delays, E=r(n, 2, scale=0.3) if uncertain else None, H=H[0])
        loop = loop_of(system)
        if abscissa(loop) > -0.05:
            continue
        loss = first_loss(loop, 0)
        if finite and loss > 10:
            continue
        d = rng.uniform(0.3, 0.97) * loss if loss < 10 else rng.uniform(0.3, 3)
        if abscissa(loop.at(0, d)) < -1e-3:
            break
    delays = list(with_delays(system, [float(d), *lengths[1:]]).delays)
    delays[-1] = replace_feedback(delays[-1]) if late else delays[-1]
    q, p = int(rng.integers(1, 3)), int(rng.integers(1, 3))
    C, D = (r(n, q), np.vstack([r(p, n), np.zeros((1, n))])) if performance else (None, None)
    D1 = np.vstack([r(p, q, scale=0.1), np.zeros((1, q))]) if performance else None
    D2 = np.vstack([np.zeros((p, 1)), [[0.3]]]) if performance else None
    return DelaySystem(A, r(n, 1), C, D, D1, D2, system.E, system.H, delays)


def replace_feedback(delay: Delay) -> Delay:
    """The same delay, through which the control acts."""
    return Delay(delay.d, delay.A, delay.H, feedback=True, any_age=delay.any_age)


def admissible(system: DelaySystem, rng: np.random.Generator) -> list[Any]:
    """F = 0, vertices, random contractions, real and complex."""
    if not system.E.size:
        return [None]
    s, r = system.E.shape[1], system.H.shape[0]
    found: list[Any] = [None, np.eye(s, r), -np.eye(s, r), np.diag([1.0, -1.0])]
    for part in (0.0, 0.0, 1j):
        M = rng.standard_normal((s, r)) + part * rng.standard_normal((s, r))
        found.append(M / np.linalg.norm(M, 2))
        U, _, V = np.linalg.svd(M)
        found.append(U @ V)  # all singular values 1
    return found


def check_claim(
    system: DelaySystem, K: Any, gamma: float | None, *, covers_smaller_delays: bool, seed: int = 0
) -> None:
    """The claim that the loop is stable, with a gain of at most gamma, for every admissible F."""
    lengths = np.array([x.d for x in system.delays])
    for share in (1.0, *(_SHARES if covers_smaller_delays else ())):
        at = with_delays(system, (share * lengths).tolist())
        for F in admissible(system, np.random.default_rng(seed)):
            loop = loop_of(at, K, F)
            if not abscissa(loop) < 0:
                raise BeyondTruthError(f"claimed stable, {abscissa(loop)=}, {share=}, {F=}")
            if gamma is None:
                continue
            truth = norm(loop) if F is None and share == 1 else attained_gain(loop)
            if not truth * (1 - _ROUNDING) <= gamma:
                raise BeyondTruthError(f"claimed {gamma=}, attained {truth}, {share=}, {F=}")


def check_delay_claim(system: DelaySystem, K: Any, delay_index: int, d: float) -> None:
    """The claim that the loop is stable with delay `delay_index` up to d, the others held."""
    loss = first_loss(loop_of(system, K), delay_index)
    if not d * (1 - _ROUNDING) <= loss:
        raise BeyondTruthError(f"claimed delay {d}, exact {loss}")


def claims(seed: int, tally: Counter[str]) -> None:
    """What is claimed of one system, held against the truth."""
    system = random_stable(seed)
    n, N = len(system.A), len(system.delays)
    rows = {order: (1 + N * (1 + order)) * n for order in (0, 1, 2)}
    orders = [order for order in rows if rows[order] <= 18 or order == 0]
    least = None
    for order in orders:
        found = analyse(system, order=order)
        if found.certified:
            check_claim(
                system,
                None,
                found.gamma,
                covers_smaller_delays=found.covers_smaller_delays,
                seed=seed,
            )
            least, exact = found.gamma, found.exact_norm
            tally["analysis"] += 1
            tally["up to"] += order > 0 and found.covers_smaller_delays
            tally["tight"] += least is not None and least < 1.02 * float(exact or 0)
    quick = [order for order in rows if rows[order] <= 12 or order == 0]
    if seed % 2 or n < 5:
        _delay(system, seed, quick[-1 - seed % 2 if len(quick) > 1 else 0], None, tally)
    if least is not None and seed % 16 == 1:
        _delay(system, seed, 0, 1.1 * least, tally)
    if seed % 3 == 1:
        _designs(system, seed, tally)
    if n == 2:
        _bessel_legendre(system, seed, tally)


def _delay(
    system: DelaySystem, seed: int, order: int, gamma: float | None, tally: Counter[str]
) -> None:
    loss = first_loss(loop_of(system), 0)
    limit = 1.5 * loss if np.isfinite(loss) else 5.0
    found = certified_delay(system, gamma=gamma, order=order, limit=limit)
    if found.delay is not None:
        check_delay_claim(system, None, 0, found.delay)
        check_claim(
            found.result.system,
            None,
            gamma,
            covers_smaller_delays=found.result.covers_smaller_delays,
            seed=seed,
        )
        tally["delay"] += 1
        tally["tight delay"] += found.delay > 0.95 * loss


def _designs(system: DelaySystem, seed: int, tally: Counter[str]) -> None:
    system = with_delays(system, [0.3 * x.d for x in system.delays])
    k2 = [0.5 / x.d for x in system.delays]
    k1 = [-0.2 * value for value in k2]
    delay_index = next((j for j, x in enumerate(system.delays) if x.feedback), 0)
    try:
        made = design(system, k1, k2, alternatives=False)
        check_claim(system, made.K, made.gamma, covers_smaller_delays=True, seed=seed)
        tally["design"] += 1
        goal = None if made.gamma is None else 1.2 * made.gamma
        order: Literal["auto"] | None = "auto" if len(system.A) < 4 else None  # else minutes
        greatest = greatest_delay(
            system, goal, k1, k2, delay_index=delay_index, limit=5.0, order=order
        )
        at = greatest.result
        check_claim(at.system, at.K, at.gamma, covers_smaller_delays=True, seed=seed)
        check_delay_claim(system, at.K, delay_index, greatest.delay)
        tally["design delay"] += 1
    except NotAchievableError:
        tally["no design"] += 1


def _bessel_legendre(system: DelaySystem, seed: int, tally: Counter[str]) -> None:
    N = len(system.delays)
    with suppress(NotAchievableError):
        made = design(system, [-0.5] * N, [1.0] * N, order=seed % 3, alternatives=False)
        check_claim(
            system, made.K, made.gamma, covers_smaller_delays=made.covers_smaller_delays, seed=seed
        )
        tally["bessel_legendre design"] += 1


def enough(tally: Counter[str], systems: int) -> None:
    """There were claims to be held against the truth, and tight ones."""
    assert tally["analysis"] >= systems / 2
    assert tally["tight"] >= systems / 8
    assert tally["delay"] >= systems / 3
    assert tally["up to"] >= systems / 10
    assert tally["tight delay"] >= systems / 20
    assert tally["design"] >= systems / 10
    assert tally["design delay"] >= systems / 10
    assert tally["bessel_legendre design"] >= 1


@pytest.mark.slow
@pytest.mark.parametrize("first", share_of(range(0, 200, 20)))
def test_nothing_is_claimed_beyond_the_truth_of_two_hundred_systems(first: int) -> None:
    """All of them and all that is claimed of them, twenty at a time."""
    tally: Counter[str] = Counter()
    for seed in range(first, first + 20):
        claims(seed, tally)
    enough(tally, 20)


def test_false_claims_are_caught() -> None:
    """A claim off by a thousandth, of each kind, is contradicted: the judge can say no."""
    system = random_stable(20)
    loop = loop_of(system)
    assert not system.E.size
    truth, loss = norm(loop), first_loss(loop, 0)
    check_claim(system, None, truth, covers_smaller_delays=False)
    check_delay_claim(system, None, 0, loss)
    with pytest.raises(BeyondTruthError, match="claimed gamma"):
        check_claim(system, None, 0.999 * truth, covers_smaller_delays=False)
    with pytest.raises(BeyondTruthError, match="claimed delay"):
        check_delay_claim(system, None, 0, 1.001 * loss)
    with pytest.raises(BeyondTruthError, match="claimed stable"):
        check_claim(with_delays(system, [1.001 * loss]), None, None, covers_smaller_delays=False)


def test_a_claim_that_forgets_the_uncertainty_is_caught() -> None:
    """The exact nominal norm is no bound for every admissible F."""
    system = random_stable(10)
    assert system.E.size
    with pytest.raises(BeyondTruthError, match="claimed gamma"):
        check_claim(system, None, norm(loop_of(system)), covers_smaller_delays=False)


def test_a_claim_about_smaller_delays_is_looked_at_there() -> None:
    """A loop that needs its delay is stable at 1, and not at every delay up to 1."""
    system = DelaySystem([[0.0, 1.0], [-2.0, 0.1]], delays=[Delay(1.0, [[0.0, 0.0], [1.0, 0.0]])])
    check_claim(system, None, None, covers_smaller_delays=False)
    with pytest.raises(BeyondTruthError, match="claimed stable"):
        check_claim(system, None, None, covers_smaller_delays=True)


def test_independent_methods_agree() -> None:
    """Sweep and pencil find one margin; level set and branch and bound one norm."""
    published = DelaySystem([[-2, 0], [0, -0.9]], delays=[Delay(1.0, [[-1, 0], [-1, -1]])])
    assert first_loss(loop_of(published), 0) == pytest.approx(6.172581371, rel=1e-9)
    for seed in (0, 1, 2, 3):
        system = random_stable(seed)
        loop = loop_of(system)
        d = first_loss_by_pencil(loop.A[0], loop.A[1])
        assert first_loss(loop, 0) == pytest.approx(d, rel=1e-9)
        assert abs(abscissa(loop.at(0, d))) < 1e-7
        if system.has_performance:
            other = hinf_norm(close(system, np.zeros((1, len(system.A)))))
            assert other is not None
            assert norm(loop) == pytest.approx(other.value, rel=1e-8)
