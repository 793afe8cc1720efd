"""Theorem 1 and the Bessel-Legendre conditions for a given gain: what is certified, and is true.

The truths from outside: published delay bounds, Theorem 1's LMI as printed with its own M1, M2
(in cvxpy, here), the functional's derivative along polynomials, the exact roots and norm.
"""

from __future__ import annotations

import copy
import json
import warnings
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from numpy.polynomial import Legendre, Polynomial
from shared import sampled
from solver_points import Array, benchmark, random_system

from cosim.core import InputError
from cosim.hinf import analyse, auv_system, certified_delay, check_certificate, hinf_norm
from cosim.hinf.certificate import analysis_from_json
from cosim.hinf.delay_lti import close
from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi import Condition
from cosim.hinf.theorems import Age, Loop, minus_phi, with_inverse_of_gamma
from cosim.models import Delay, DelaySystem, paper_example

PRINTED = [paper_example.PRINTED_K]
EXACT_BOUND = 6.172581371
"""The benchmark's greatest delay (published, exact)."""


def theorem_1(system: DelaySystem, K: Array) -> float:
    """Least gamma of Theorem 1 as it stands: M1, M2 free, Lemmas 1 and 3 by Schur complements."""
    n, N, q = len(system.A), len(system.delays), system.C.shape[1]
    acts = [system.immediate_feedback, *(x.feedback for x in system.delays)]
    open_A = [system.A, *(x.A for x in system.delays)]
    A = [M + system.B @ K if phi else M for M, phi in zip(open_A, acts, strict=True)]
    D = [(i == 0) * system.D + phi * (system.D2 @ K) for i, phi in enumerate(acts)]
    H = np.hstack([system.H, *(x.H for x in system.delays)])
    P = cp.Variable((n, n), symmetric=True)
    Q = [np.zeros((n, n)) if x.any_age else cp.Variable((n, n), PSD=True) for x in system.delays]
    R = [cp.Variable((n, n), PSD=True) for _ in system.delays]
    M1, M2 = ([cp.Variable((n, n)) for _ in range(N)] for _ in range(2))
    eps, gamma = cp.Variable(), cp.Variable()
    zero = np.zeros((n, n))
    top: list[list[Any]] = [[zero] * (N + 1) for _ in range(N + 1)]
    top[0][0] = P @ A[0] + A[0].T @ P + sum(Q) + sum(M + M.T for M in M1)
    for j in range(1, N + 1):
        top[0][j] = P @ A[j] - M1[j - 1].T + M2[j - 1]
        top[j][0] = top[0][j].T
        top[j][j] = -Q[j - 1] - M2[j - 1] - M2[j - 1].T
    core = cp.bmat(top) + eps * H.T @ H
    ends = [cp.vstack([P @ system.C, np.zeros((N * n, q))]), np.hstack(D).T]
    corner = cp.bmat([[-gamma * np.eye(q), system.D1.T], [system.D1, -gamma * np.eye(len(D[0]))]])
    rows, corners, columns = [cp.hstack(ends)], [corner], [cp.vstack([P @ system.E])]
    E_rows = [np.zeros((corner.shape[0], system.E.shape[1]))]
    for j, x in enumerate(system.delays):
        on_w = cp.hstack([x.d * R[j] @ system.C, np.zeros((n, len(D[0])))])
        rows.append(cp.hstack(A).T @ R[j] * x.d)
        corners.append((on_w, -x.d * R[j]))
        place = [M1[j].T, *(M2[j].T if i == j else zero for i in range(N))]
        rows.append(x.d * cp.vstack(place))
        corners.append((np.zeros(on_w.shape), -x.d * R[j]))
        E_rows += [x.d * R[j] @ system.E, np.zeros((n, system.E.shape[1]))]
    size = [row.shape[1] for row in rows]
    blocks: list[list[Any]] = [
        [core, *rows, cp.vstack([*columns, np.zeros((N * n, system.E.shape[1]))])]
    ]
    for i in range(len(rows)):
        line: list[Any] = [rows[i].T]
        for k in range(len(rows)):
            if i == k:
                line.append(corners[i] if i == 0 else corners[i][1])
            elif 0 in {i, k}:
                link = corners[max(i, k)][0]
                line.append(link if k == 0 else link.T)
            else:
                line.append(np.zeros((size[i], size[k])))
        blocks.append([*line, E_rows[i]])
    last = [blocks[i][-1].T for i in range(len(blocks))]
    blocks.append([*last, -eps * np.eye(system.E.shape[1])])
    whole = cp.bmat(blocks)
    problem = cp.Problem(cp.Minimize(gamma), [(whole + whole.T) / 2 << 0, P >> 0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        problem.solve(solver=cp.CLARABEL)  # type: ignore[no-untyped-call]
    return float(problem.value) if problem.status.startswith("optimal") else np.inf


def test_the_printed_gain_of_section_5() -> None:
    """Theorem 1 gives 5.0455 for it, uncertainty included; its exact norm is 5.0276."""
    found = analyse(paper_example.system(), PRINTED, order=0)
    assert found.certified
    assert found.gamma == pytest.approx(5.0455, abs=1e-4)
    assert found.exact_norm == pytest.approx(5.0276, abs=1e-4)
    assert found.reason is None
    proof = check_certificate(json.loads(json.dumps(found.certificate)))
    assert proof.valid
    assert Fraction(proof.claim["gamma"]) == Fraction(float(found.gamma or 0))
    assert proof.claim["delays"][0]["age"] == "constant, up to d"


def test_order_0_is_theorem_1_with_its_own_M1_and_M2() -> None:
    """The printed LMI, its M1, M2 free, has the same least gamma: nothing lost without them."""
    rng = np.random.default_rng(5)
    cases = [(paper_example.system(), np.array(PRINTED))]
    cases += [
        (random_system(rng, late=late, any_age=any_age, uncertain=True, scale=0.3), K)
        for late, any_age in ((False, False), (True, False), (True, True))
        for K in (0.1 * rng.standard_normal((1, 2)),)
    ]
    for system, K in cases:
        found = analyse(system, K, order=0)
        assert found.certified, found.reason
        assert found.least_gamma == pytest.approx(theorem_1(system, K), rel=1e-5)
        assert float(found.exact_norm or 0) <= float(found.gamma or 0)


@pytest.mark.parametrize(
    ("order", "d", "beyond"),
    [(0, 4.472, 4.4722), (1, 6.059, 6.06), (2, 6.1689, 6.17), (3, 6.1725, 6.1726)],
)
def test_the_published_ladder(order: int, d: float, beyond: float) -> None:
    """The benchmark's delays of Seuret and Gouaisbaut are certified, and a little more is not."""
    found = analyse(benchmark(d), order=order)
    assert found.certified
    assert found.gamma is None
    proof = check_certificate(json.loads(json.dumps(found.certificate)))
    assert proof.valid
    assert proof.claim["property"] == "stability"
    assert proof.claim["delays"][0]["age"] == "constant, up to d"
    refused = analyse(benchmark(beyond), order=order)
    assert not refused.certified
    assert refused.certificate is None
    assert refused.reason


@pytest.mark.parametrize("order", sampled([1, 3, 0, 2, 4, 5], 1))
def test_the_certified_delay_climbs_and_stays_below_the_truth(order: int) -> None:
    """The ladder to all its published digits, each certified, none above 6.172581371."""
    found = certified_delay(benchmark(1.0), order=order)
    ladder = (4.472, 6.059, 6.1689, 6.1725, 6.1725, 6.1725)
    assert found.delay is not None
    assert found.not_certified_at is not None
    assert ladder[order] <= found.delay < min(found.not_certified_at, EXACT_BOUND)
    assert found.not_certified_at - found.delay < 1e-5 * found.delay
    assert not found.limit_reached
    assert found.result.covers_smaller_delays or order > 3
    assert check_certificate(found.result.certificate).valid


def test_a_loop_stable_for_every_delay_stops_at_the_limit() -> None:
    """The printed loop is stable for every delay, at gamma 6 as well: the search says so."""
    for gamma in (None, 6.0):
        found = certified_delay(paper_example.system(), PRINTED, gamma, limit=50.0)
        assert (found.delay, found.limit_reached, found.not_certified_at) == (50.0, True, None)
        assert check_certificate(found.result.certificate).valid


def test_a_loop_that_bears_no_delay_has_no_greatest_one() -> None:
    """x' = x - 0.5 x(t-d) is unstable at d = 0 and at every other."""
    system = DelaySystem([[1.0]], delays=[Delay(1.0, [[-0.5]])])
    for order in (0, 2):
        found = certified_delay(system, order=order)
        assert found.delay is None
        assert found.result.certificate is None
        assert not found.result.certified
        assert not found.limit_reached


@pytest.mark.slow
def test_a_loop_that_needs_its_delay() -> None:
    """A = [0 1; -2 0.1], Ad = [0 0; 1 0] (Seuret and Gouaisbaut) is stable for d in an interval.

    Its ends are roots of (2 - v^2)^2 + 0.01 v^2 = 1, v the frequency, where sin(v d) = 0.1 v
    and cos(v d) = 2 - v^2: 0.1002 and 1.7179.
    """
    v = np.sqrt((3.99 + np.sqrt(3.99**2 - 12)) / 2)
    end = np.arctan2(0.1 * v, 2 - v**2) / v
    system = DelaySystem([[0.0, 1.0], [-2.0, 0.1]], delays=[Delay(1.0, [[0, 0], [1, 0]])])
    assert not analyse(system, order=0).certified
    assert analyse(system, order=2).certified
    found = certified_delay(system, order=4)
    assert found.delay is not None
    assert found.result.covers_smaller_delays is False
    assert 1.7178 < found.delay < end
    assert found.not_certified_at is not None
    assert found.delay < found.not_certified_at
    assert check_certificate(found.result.certificate).valid


def test_any_age_is_theorem_1_at_order_0_and_without_Q() -> None:
    """x' = -x(t-tau(t)), tau <= d: known to be stable up to 3/2, and not beyond.

    The claim never says "exactly" there, and a Q in the certificate is refused. From order 1 on
    it is a certificate of ages, which reaches further.
    """
    for d, order, message in ((0.99, 0, "does not fit"), (1.33, 3, "no key 'Q'")):
        system = DelaySystem([[0.0]], delays=[Delay(d, [[-1.0]], any_age=True)])
        found = analyse(system, order=order)
        assert found.certified
        assert analyse(system, order=0).certified is (order == 0)
        assert found.covers_smaller_delays
        data: Any = json.loads(json.dumps(found.certificate))
        assert "any" in data["claim"]["delays"][0]["age"]
        data["variables"]["Q"] = [[["1"]]]
        with pytest.raises(InputError, match=message):
            check_certificate(data)
    system = DelaySystem([[0.0]], delays=[Delay(1.51, [[-1.0]], any_age=True)])
    assert not analyse(system, order=3).certified


def test_a_delay_of_zero_is_no_delay() -> None:
    """x' = -x + 0.5 x(t-0) + w, z = x has gain 1 / 0.5, with or without the delay's name."""
    named = DelaySystem([[-1.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(0.0, [[0.5]])])
    plain = DelaySystem([[-0.5]], C=[[1.0]], D=[[1.0]])
    for system in (named, plain):
        found = analyse(system, order=1)
        assert found.gamma == pytest.approx(2.0, rel=1e-5)
        assert check_certificate(found.certificate).valid


def test_an_unstable_loop_is_named_so() -> None:
    """Beyond 6.1726 the benchmark is unstable: not certified at any order, and it says why."""
    found = analyse(benchmark(6.2), order=3)
    assert not found.certified
    assert "not stable" in str(found.reason)


def test_a_gamma_below_the_least_is_not_certified() -> None:
    """|D1| = 5 bounds every gain from below; above the least, the bound asked for is proved."""
    system = paper_example.system()
    for gamma in (4.0, 5.0, 5.04):
        found = analyse(system, PRINTED, gamma, order=0)
        assert not found.certified
        assert found.gamma is None
    assert analyse(system, PRINTED, 5.5).gamma == 5.5


def test_the_vehicle() -> None:
    """Eight states, two delays of any age: certified above the exact nominal norm."""
    K = -np.hstack(
        [np.diag([0.0749, 0.0717, 0.0470, 0.0524]), np.diag([0.5349, 0.5441, 0.5393, 0.5352])]
    )
    found = analyse(auv_system(), K)
    norm = hinf_norm(close(auv_system(), K))
    assert norm is not None
    assert norm.value < float(found.gamma or 0) < 1.5 * norm.value
    assert check_certificate(found.certificate).valid


@pytest.mark.slow
def test_random_loops_are_never_promised_more_than_the_truth() -> None:
    """Certified gammas stay above the exact norm of loops of two to four states, at each order."""
    rng = np.random.default_rng(11)
    certified = 0
    for trial in range(15):
        n = 2 + trial % 3
        A = rng.standard_normal((n, n)) - 1.5 * np.eye(n)
        delays = [Delay(float(rng.uniform(0.1, 2)), 0.5 * rng.standard_normal((n, n)))]
        C, D = rng.standard_normal((n, 1)), rng.standard_normal((1, n))
        system = DelaySystem(A, C=C, D=D, delays=delays)
        norm = hinf_norm(close(system, np.zeros((0, n))))
        last = np.inf
        for order in (0, 1, 2):
            found = analyse(system, order=order)
            if norm is None:
                assert not found.certified
                continue
            if found.certified:
                certified += 1
                assert norm.value <= float(found.gamma or 0) <= last * (1 + 1e-4)
                last = float(found.gamma or 0)
    assert certified > 15


def test_phi_is_the_derivative_of_the_functional() -> None:
    """Along pasts whose derivative is a polynomial of degree N, Bessel's inequality is equality.

    There V' + z'z/gamma - gamma w'w + eps (q'q - p'p), from its integrals, is the form Phi.
    """
    rng = np.random.default_rng(3)
    N, n, d, gamma, eps = 2, 2, 0.75, 3.0, 0.5
    system = random_system(rng, late=False, any_age=False, uncertain=True)
    delay = Delay(d, system.delays[0].A, system.delays[0].H)
    system = DelaySystem(
        **{k: getattr(system, k) for k in ("A", "B", "C", "D", "D1", "D2", "E", "H")},
        delays=[delay],
    )
    K = rng.standard_normal((1, n))

    def symmetric(size: int) -> Array:
        M = rng.standard_normal((size, size))
        return M + M.T

    P, Q, R = symmetric(n * (1 + N)), symmetric(n), symmetric(n)
    unknowns = {name: exact_matrix(M) for name, M in (("P", P), ("Q[0]", Q), ("R[0]", R))}
    unknowns |= {"eps[0]": exact(eps), "gamma": exact(gamma), "1/gamma": 1 / exact(gamma)}
    loop = Loop.of(system, K)
    form = minus_phi(loop, [Age(loop, 0, "constant", N)], [(exact(d), 0)], bounded=True)
    lower = form.at(unknowns)
    Phi = np.zeros((len(lower), len(lower)))
    for i, row in enumerate(lower):
        for j, entry in enumerate(row):
            Phi[i, j] = Phi[j, i] = -float(Fraction(str(entry)))
    past = [
        Polynomial(rng.standard_normal(N + 2), domain=[-d, 0], window=[-d, 0]) for _ in range(n)
    ]
    kernels = [Legendre.basis(k, domain=[-d, 0]).convert(kind=Polynomial) for k in range(N)]

    def integral(f: Callable[[float], Any]) -> Any:
        nodes, weights = np.polynomial.legendre.leggauss(12)
        at = d / 2 * (nodes - 1)
        return sum(d / 2 * b * f(a) for a, b in zip(at, weights, strict=True))

    def x(s: float) -> Array:
        return np.array([one(s) for one in past])

    def rate(s: float) -> Array:
        return np.array([one.deriv()(s) for one in past])

    w, p = rng.standard_normal(2), rng.standard_normal(3)
    means = [integral(lambda s, L=L: L(s) * x(s)) / d for L in kernels]
    f = (system.A + system.B @ K) @ x(0) + delay.A @ x(-d) + system.C @ w + system.E @ p
    z = (system.D + system.D2 @ K) @ x(0) + system.D1 @ w
    q = system.H @ x(0) + delay.H @ x(-d)
    y = np.concatenate([x(0), *(d * m for m in means)])
    change = np.concatenate([f, *(integral(lambda s, L=L: L(s) * rate(s)) for L in kernels)])
    truth = 2 * y @ P @ change + x(0) @ Q @ x(0) - x(-d) @ Q @ x(-d)
    truth += d**2 * f @ R @ f - d * integral(lambda s: rate(s) @ R @ rate(s))
    truth += z @ z / gamma - gamma * w @ w + eps * (q @ q - p @ p)
    xi = np.concatenate([x(0), x(-d), *means, w, p])
    assert len(xi) == len(lower)
    assert xi @ Phi @ xi == pytest.approx(truth, rel=1e-9)


def test_a_box_of_delays_is_proved_at_its_corners() -> None:
    """One proof for every pair of delays up to the system's; inside, -Phi is positive as well."""
    rng = np.random.default_rng(8)
    system = random_system(rng, late=True, any_age=False, uncertain=True, scale=0.3)
    K = 0.1 * rng.standard_normal((1, 2))
    tight = analyse(system, K, order=1)
    assert tight.gamma is not None
    found = analyse(system, K, 1.3 * tight.gamma, order=1)
    assert found.covers_smaller_delays
    proof = check_certificate(found.certificate)
    assert [delay["age"] for delay in proof.claim["delays"]] == ["constant, up to d"] * 2
    table = json.loads(json.dumps(found.certificate))["variables"]
    v = analysis_from_json(system, K, table)
    unknowns = with_inverse_of_gamma(v.unknowns)
    loop = Loop.of(system, K)
    ages = [Age(loop, j, "constant", 1) for j in range(2)]
    for shares in ((0, 0), (0, 1), (1, 1), (0.3, 0.8), (0.5, 0.5), (0.9, 0.1)):
        d = [(exact(share * x.d), 0) for share, x in zip(shares, system.delays, strict=True)]
        assert minus_phi(loop, ages, d, bounded=v.gamma is not None).failure(unknowns) is None


def test_a_delay_box_with_too_small_a_lower_end_is_refused() -> None:
    """The loop that needs its delay: proved from 0.4 on, and not from 0.1 on."""
    system = DelaySystem([[0.0, 1.0], [-2.0, 0.1]], delays=[Delay(1.5, [[0, 0], [1, 0]])])
    found = analyse(system, order=2)
    assert found.certified
    assert not found.covers_smaller_delays
    data: Any = json.loads(json.dumps(found.certificate))
    assert "lower" not in data["variables"]

    def down_to(lower: Any) -> Any:
        other = copy.deepcopy(data)
        del other["theorem"]  # the words of another claim
        other["variables"]["lower"] = [lower]
        other["claim"]["delays"][0]["age"] = f"constant, from {lower} to d"
        return other

    assert check_certificate(down_to("5/4")).valid
    refused = check_certificate(down_to("1/10"))
    assert not refused.valid
    assert "at age 0.1" in str(refused.reason)
    for lower in ("2", "-1/10", None, 0.5):
        with pytest.raises(InputError):
            check_certificate(down_to(lower))
    silent = down_to("5/4")
    silent["claim"]["delays"][0]["age"] = "constant, up to d"
    assert not check_certificate(silent).valid


def test_every_tampered_certificate_is_refused() -> None:
    """Whatever is changed so that the claim changes, or no longer follows, is not valid."""
    found = analyse(paper_example.system(), PRINTED, order=1)
    good: Any = json.loads(json.dumps(found.certificate))
    assert check_certificate(good).valid

    def changed(*path: Any, to: Any) -> Any:
        data = copy.deepcopy(good)
        place = data
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = to
        return data

    for data in (
        changed("variables", "gamma", to="5"),
        changed("claim", "gamma", to="5"),
        changed("claim", "delays", 0, "age", to="constant, exactly d"),
        changed("claim", "order", to=0),
        changed("variables", "P", 0, 1, to="0"),
        changed("variables", "R", 0, 0, 0, to="-1"),
        changed("variables", "Q", 0, 0, 0, to="-1"),
        changed("variables", "eps", to="-1"),
        changed("variables", "eps", to="1000000"),
        changed("K", 0, 0, to=6.0),
        changed("system", "A", 0, 0, to=5.0),
    ):
        assert not check_certificate(data).valid
    gamma = changed("variables", "gamma", to="-1")
    gamma["claim"]["gamma"] = "-1"
    assert check_certificate(gamma).reason == "gamma is not positive"
    for data in (
        changed("kind", to="Analysis"),
        changed("kind", to=None),
        changed("variables", "order", to=True),
        changed("variables", "order", to=-1),
        changed("variables", "order", to=2),
        changed("variables", "order", to=10**9),
        changed("variables", "Q", 0, to=None),
        changed("variables", "Q", to=[]),
        changed("variables", "eps", to=None),
        changed("variables", "P", 0, 0, to=1.0),
        changed("K", to=[[1.0]]),
    ):
        with pytest.raises(InputError):
            check_certificate(data)


def test_each_part_of_the_functional_is_positive() -> None:
    """Where the delay hardly acts -Phi > 0 does not need R; the functional does."""
    system = DelaySystem([[-4.0]], delays=[Delay(0.3, [[0.5]])])
    found = analyse(system, np.zeros((0, 1)), order=0)
    for name, value, reason in (
        ("R", "1/1000000", None),
        ("R", "-1/1000000", "R[0] is not positive definite"),
        ("Q", "0", "Q[0] is not positive definite"),
    ):
        data = json.loads(json.dumps(found.certificate))
        data["variables"][name] = [[[value]]]
        assert check_certificate(data).reason == reason


def test_what_does_not_fit_is_bad_input() -> None:
    """A gain of another shape, a gamma or an order that is none, an absent delay: each named."""
    system = paper_example.system()
    for call in (
        lambda: analyse(system, [[1.0]]),
        lambda: analyse(system, [[np.nan, 0.0]]),
        lambda: analyse(system, [[1.0, 2.0], [3.0]]),
        lambda: analyse(system, PRINTED, -1.0),
        lambda: analyse(system, PRINTED, np.inf),
        lambda: analyse(system, PRINTED, order=-1),
        lambda: analyse(system, PRINTED, order=13),
        lambda: analyse(benchmark(1.0), gamma=1.0),
        lambda: certified_delay(system, PRINTED, delay_index=1),
        lambda: certified_delay(system, PRINTED, order=13),
        lambda: certified_delay(system, PRINTED, limit=0.0),
        lambda: certified_delay(benchmark(1.0), gamma=1.0),
        lambda: certified_delay(DelaySystem([[-1.0]])),
    ):
        with pytest.raises(InputError):
            call()


def test_a_gamma_that_is_asked_for_is_proved_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However far above the least one it is: no other order can say more."""
    asked: list[int] = []
    usual = Condition.least_gamma

    def counted(condition: Condition, *arguments: Any) -> float | None:
        asked.append(condition.order)
        return usual(condition, *arguments)

    monkeypatch.setattr(Condition, "least_gamma", counted)
    assert analyse(paper_example.system(), PRINTED, 50.0).gamma == 50.0
    assert asked == [0]


def test_a_higher_order_for_smaller_delays_too_where_exactly_these_would_not_be_claimed() -> None:
    """Six percent less than by Theorem 1, within a thousandth of the exact norm."""
    system = DelaySystem(
        [[-2.85, -0.17], [1.66, -1.54]],
        None,
        [[-1.64], [-0.01]],
        [[-0.62, 0.15]],
        delays=[Delay(1.08, [[0.24, 0.24], [1.58, 0.32]])],
    )
    plain, found = (analyse(system, order=order) for order in (0, "auto"))
    assert found.covers_smaller_delays
    assert found.order in (1, 2)
    assert found.gamma is not None
    assert plain.gamma is not None
    assert found.exact_norm is not None
    assert found.exact_norm < found.gamma < min(0.95 * plain.gamma, 1.001 * found.exact_norm)
