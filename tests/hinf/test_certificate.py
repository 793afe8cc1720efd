"""The exact certificate: what it proves, what it refuses, and that its table is the right one.

The truths from outside: the Lyapunov-Krasovskii functional's derivative, coded here from its
definition; frequency sweeps; the rightmost roots of the delay equation; fractions and leading
minors. Solutions come from the solver's LMI, which the certificate shares no code with.
"""

from __future__ import annotations

import copy
import json
import warnings
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import cvxpy as cp
import flint
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import block_diag

from cosim.errors import InputError
from cosim.hinf.certificate import (
    Variables,
    certificate_to_json,
    certify,
    check_certificate,
    read_certificate,
)
from cosim.hinf.exact_lmi import ExactLmi, minus_omega
from cosim.hinf.lmi import Unknowns, omega, unknowns
from cosim.hinf.proof import exact_variables
from cosim.hinf.rational import MAX_DIGITS, exact_matrix, first_bad_pivot, from_text
from cosim.models import paper_example
from cosim.models.delay_system import Delay, DelaySystem

Array = NDArray[np.float64]


def _value(expression: Any) -> Array:
    return np.asarray(getattr(expression, "value", expression), dtype=np.float64)


def _solved(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], gamma: float | None
) -> tuple[str, Array, Variables]:
    """Solver's word, gain and variables of greatest margin."""
    v = unknowns(system, gain=None, gamma=gamma)
    whole, positive = omega(system, k1, k2, v)
    n, margin = system.A.shape[0], cp.Variable()
    constraints = [(whole + whole.T) / 2 << -margin * np.eye(whole.shape[0]), margin <= 1]
    constraints += [v.X << 100 * np.eye(n), *(p >> margin * np.eye(n) for p in positive)]
    problem = cp.Problem(cp.Maximize(margin), constraints)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is a case like any other
        problem.solve(solver=cp.CLARABEL)
    X = _value(v.X)
    K = np.linalg.solve(X.T, _value(v.Y).T).T if system.B.shape[1] else np.zeros((0, n))
    eps = None if v.eps.value is None else float(v.eps.value)
    Q, R = tuple(map(_value, v.Q)), tuple(map(_value, v.R))
    return problem.status, K, Variables(X, Q, R, eps, k1, k2, gamma)


@pytest.fixture(scope="module")
def paper() -> tuple[DelaySystem, Array, Variables]:
    """Section 5 at gamma = 5.05, k1 = 0.6, k2 = 0.2."""
    system = paper_example.system()
    status, K, variables = _solved(system, (0.6,), (0.2,), 5.05)
    assert status == "optimal"
    return system, K, variables


@pytest.fixture(scope="module")
def paper_json(paper: tuple[DelaySystem, Array, Variables]) -> Any:
    """Its certificate, once through a file's text."""
    return json.loads(json.dumps(certificate_to_json(*paper)))


def _random_system(
    rng: np.random.Generator, *, late: bool, any_age: bool, uncertain: bool, scale: float = 1.0
) -> DelaySystem:
    """n = 2, m = 1, q = 2, p = 2, two delays; the second may carry the feedback."""

    def r(*shape: int) -> Array:
        return scale * rng.standard_normal(shape)

    H = [r(2, 2) for _ in range(3)] if uncertain else [None] * 3
    delays = (
        Delay(float(rng.uniform(0.1, 0.8)), r(2, 2), H[1]),
        Delay(float(rng.uniform(0.1, 0.8)), r(2, 2), H[2], feedback=late, any_age=any_age),
    )
    A = r(2, 2) - 3 * scale * np.eye(2)
    E = r(2, 3) if uncertain else None
    return DelaySystem(A, r(2, 1), r(2, 2), r(2, 2), r(2, 2), r(2, 1), E, H[0], delays)


def _random_variables(rng: np.random.Generator, system: DelaySystem) -> Variables:
    """Positive matrices that need not solve anything."""

    def positive() -> Array:
        G = rng.standard_normal((2, 2))
        return G @ G.T + np.eye(2)

    Q = tuple(np.zeros((2, 2)) if x.any_age else positive() for x in system.delays)
    R = tuple(positive() for _ in system.delays)
    # eps small: the p-part of the functional below stays negative definite
    k1, k2 = (tuple(rng.uniform(0.2, 1, 2) * rng.choice((-1, 1), 2)) for _ in range(2))
    return Variables(positive(), Q, R, 1e-3, k1, k2, 50.0)


def _dense(lmi: ExactLmi) -> Array:
    """Omega in doubles."""
    size = len(lmi.lower)
    result = np.zeros((size, size))
    for i, row in enumerate(lmi.lower):
        for j, entry in enumerate(row):
            result[i, j] = result[j, i] = -float(Fraction(int(entry.p), int(entry.q)))
    return result


def _eliminated(matrix: Array, keep: list[int]) -> Array:
    """Schur complement onto the indices `keep`: the maximum over all the others."""
    rest = [i for i in range(len(matrix)) if i not in keep]
    if not rest:
        return matrix
    assert np.linalg.eigvalsh(matrix[np.ix_(rest, rest)]).max() < 0
    cross = matrix[np.ix_(keep, rest)]
    block = np.linalg.solve(matrix[np.ix_(rest, rest)], cross.T)
    return matrix[np.ix_(keep, keep)] - cross @ block


def _form(q: Callable[[Array], float], size: int) -> Array:
    """Matrix of a quadratic form, from its values."""
    e = np.eye(size)
    values = np.array([q(e[i]) for i in range(size)])
    pairs = np.array([[q(e[i] + e[j]) for j in range(size)] for i in range(size)])
    return (pairs - values[:, None] - values[None, :]) / 2


def _derivative_bound(system: DelaySystem, K: Array, v: Variables) -> Callable[[Array], float]:
    """V' + z'z/gamma - gamma w'w + (|sum H_i x_i|^2 - |p|^2)/eps as a function of (x_i, w, p).

    V is the functional; p = F sum H_i x_i, so that the last bracket is not negative for any
    admissible F. For each delay, from
    int (R x' + M s)' R^-1 (R x' + M s) >= 0 with s = (x, x_j), M s = k1 P x + k2 P x_j:
    -int x''R x' <= 2 (M s)'(x - x_j) + d (M s)' R^-1 (M s).
    """
    P = np.linalg.inv(v.X)
    A = [system.A, *(x.A for x in system.delays)]
    H = [system.H, *(x.H for x in system.delays)]
    acts = [system.immediate_feedback, *(x.feedback for x in system.delays)]
    N, q = len(system.delays), system.C.shape[1]

    def value(vector: Array) -> float:
        x = [vector[2 * i : 2 * i + 2] for i in range(N + 1)]
        w = vector[2 * N + 2 : 2 * N + 2 + q]
        p = vector[2 * N + 2 + q :]
        u = K @ x[acts.index(True)]
        rate = sum(A[i] @ x[i] for i in range(N + 1)) + system.B @ u + system.C @ w + system.E @ p
        z = system.D @ x[0] + system.D1 @ w + system.D2 @ u
        total = 2 * x[0] @ P @ rate
        for j, delay in enumerate(system.delays):
            Q, R = P @ v.Q[j] @ P, np.linalg.inv(v.R[j])
            Ms = v.k1[j] * P @ x[0] + v.k2[j] * P @ x[j + 1]
            total += x[0] @ Q @ x[0] - x[j + 1] @ Q @ x[j + 1] + delay.d * rate @ R @ rate
            total += 2 * Ms @ (x[0] - x[j + 1]) + delay.d * Ms @ v.R[j] @ Ms
        if system.E.size:
            assert v.eps is not None
            y = sum(H[i] @ x[i] for i in range(N + 1))
            total += (y @ y - p @ p) / v.eps
        assert v.gamma is not None
        return float(total + z @ z / v.gamma - v.gamma * w @ w)

    return value


CASES = [
    (late, any_age, uncertain)
    for late in (False, True)
    for any_age in (False, True)
    for uncertain in (False, True)
]


@pytest.mark.parametrize(("late", "any_age", "uncertain"), CASES)
def test_the_table_is_the_functionals_derivative(
    late: bool,  # noqa: FBT001
    any_age: bool,  # noqa: FBT001
    uncertain: bool,  # noqa: FBT001
) -> None:
    """Omega, with z, x', Lemma 2 and h eliminated, is the bound of V' built from the definition."""
    rng = np.random.default_rng(7)
    for _ in range(3):
        system = _random_system(rng, late=late, any_age=any_age, uncertain=uncertain)
        v = _random_variables(rng, system)
        K = rng.standard_normal((1, 2))
        lmi = minus_omega(system, exact_matrix(K) * exact_matrix(v.X), exact_variables(system, v))
        names = lmi.row_names
        kept = [i for i, name in enumerate(names) if name in ("x", "x1", "x2", "w")]
        ours = _eliminated(_dense(lmi), kept)
        bound = _form(_derivative_bound(system, K, v), 8 + system.E.shape[1])
        truth = _eliminated(bound, list(range(8)))
        # x = X xhat in every x row: P does not stand in Omega
        T = block_diag(v.X, v.X, v.X, np.eye(2))
        expected = T.T @ truth @ T
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize(("late", "any_age", "uncertain"), CASES)
def test_the_solvers_lmi_is_the_same_up_to_a_congruence(
    late: bool,  # noqa: FBT001
    any_age: bool,  # noqa: FBT001
    uncertain: bool,  # noqa: FBT001
) -> None:
    """Rows x_j times k2_j, rows r_j and m_j times sqrt(d_j) turn the solver's LMI into this one."""
    rng = np.random.default_rng(11)
    system = _random_system(rng, late=late, any_age=any_age, uncertain=uncertain)
    v = _random_variables(rng, system)
    K = rng.standard_normal((1, 2))
    exactly = minus_omega(system, exact_matrix(K) * exact_matrix(v.X), exact_variables(system, v))
    constants = Unknowns(
        *(cp.Constant(value) for value in (v.X, K @ v.X)),
        tuple(map(cp.Constant, v.Q)),
        tuple(map(cp.Constant, v.R)),
        v.eps,
        v.gamma,
    )
    solvers = _value(omega(system, v.k1, v.k2, constants)[0])
    factor = {"x1": v.k2[0], "x2": v.k2[1]}
    for j, delay in enumerate(system.delays, 1):
        factor |= {f"r{j}": delay.d**0.5, f"m{j}": delay.d**0.5}
    S = np.diag([factor.get(name, 1.0) for name in exactly.row_names])
    np.testing.assert_allclose(_dense(exactly), S @ solvers @ S, rtol=0, atol=1e-12 * 50)


def test_the_papers_example_is_proved_at_gamma_5_05(
    paper: tuple[DelaySystem, Array, Variables],
) -> None:
    """Feasible at 5.05 (the least gamma of the LMI at these k1, k2 is 5.0132)."""
    certificate = certify(*paper)
    assert certificate.valid
    assert certificate.reason is None
    assert certificate.claim["inputs"] == "doubles"
    assert Fraction(certificate.claim["gamma"]) == Fraction(5.05)


@pytest.mark.parametrize("gamma", [4.0, 4.99, 5.0])
def test_no_gamma_up_to_the_norm_of_D1_is_ever_proved(
    paper: tuple[DelaySystem, Array, Variables], gamma: float
) -> None:
    """|D1| = |[4; 3]| = 5 bounds every gain from below, whatever the variables."""
    system, K, v = paper
    assert not certify(system, K, _with(v, gamma=gamma)).valid
    _, other, solution = _solved(system, (0.6,), (0.2,), gamma)
    assert not certify(system, other, solution).valid


def test_a_rounded_gain_is_judged_as_it_flies() -> None:
    """Near the least gamma, K to three digits with the same X is not proved, and K itself is."""
    system = paper_example.system()
    _, K, v = _solved(system, (0.6,), (0.2,), 5.0135)
    assert certify(system, K, v).valid
    rounded = certify(system, np.round(K, 3), v)
    assert not rounded.valid
    assert rounded.reason is not None
    assert "-Omega" in rounded.reason


def _benchmark(d: float) -> DelaySystem:
    """Stable exactly for d < 6.172581371 (published example)."""
    return DelaySystem([[-2, 0], [0, -0.9]], delays=[Delay(d, [[-1, 0], [-1, -1]])])


@pytest.mark.parametrize("d", [0.0, 1e-6, 1.0, 2.0, 3.0])
def test_stability_alone_is_proved_below_the_delay_bound(d: float) -> None:
    """The benchmark is stable at these delays; the claim speaks of no gain."""
    status, K, v = _solved(_benchmark(d), (0.0,), (0.2,), None)
    certificate = certify(_benchmark(d), K, v)
    assert status == "optimal"
    assert certificate.valid, certificate.reason
    assert certificate.claim["property"] == "stability"
    assert check_certificate(certificate_to_json(_benchmark(d), K, v)) == certificate


@pytest.mark.parametrize("d", [6.2, 6.5, 20.0])
@pytest.mark.parametrize("k", [(0.0, 0.2), (-0.1, 0.3), (-0.05, 0.05)])
def test_a_solvers_optimal_at_an_unstable_delay_is_refused(
    d: float, k: tuple[float, float]
) -> None:
    """Beyond 6.1726 the loop is unstable; the solver says optimal and nothing is proved."""
    status, K, v = _solved(_benchmark(d), (k[0],), (k[1],), None)
    assert status == "optimal"
    certificate = certify(_benchmark(d), K, v)
    assert not certificate.valid
    assert certificate.reason


def test_what_is_asked_beside_omega(paper: tuple[DelaySystem, Array, Variables]) -> None:
    """k2 = 0, an indefinite Q or X, and a Q where any age is claimed are each named."""
    system, K, v = paper
    delay = system.delays[0]
    old = Delay(delay.d, delay.A, delay.H, any_age=True)
    any_age = DelaySystem(
        system.A, system.B, system.C, system.D, system.D1, system.D2, system.E, system.H, [old]
    )
    for reason, other, changed in (
        ("k2[0] is 0", system, _with(v, k2=(0.0,))),
        ("X is not positive", system, _with(v, X=-v.X)),
        ("Q[0] is not positive", system, _with(v, Q=(0 * v.Q[0],))),
        ("Q[0] is not exactly 0", any_age, v),
        ("-Omega", system, _with(v, R=(-v.R[0],))),
        ("-Omega", system, _with(v, eps=-1.0)),
        ("-Omega", system, _with(v, gamma=-5.05)),
    ):
        certificate = certify(other, K, changed)
        assert not certificate.valid
        assert reason in str(certificate.reason)


def test_at_delay_zero_R_must_still_be_positive() -> None:
    """At d = 0 the rows of R vanish from the LMI; its sign is asked for all the same."""
    _, K, v = _solved(_benchmark(0.0), (0.0,), (0.2,), None)
    certificate = certify(_benchmark(0.0), K, _with(v, R=(-v.R[0],)))
    assert certificate.reason == "R[0] is not positive definite"


def test_shapes_that_do_not_fit_are_errors(paper: tuple[DelaySystem, Array, Variables]) -> None:
    """A wrong shape or a NaN is bad input, not a failed proof."""
    system, K, v = paper
    for gain, changed in (
        (K.T, v),
        (K * np.nan, v),
        (K, _with(v, X=np.eye(3))),
        (K, _with(v, R=())),
        (K, _with(v, k1=(np.inf,))),
        (K, _with(v, eps=None)),
        (K, _with(v, Q=(v.Q[0] * np.nan,))),
    ):
        with pytest.raises(InputError):
            certify(system, gain, changed)


def _with(v: Variables, **changes: Any) -> Variables:
    return Variables(**{**v.__dict__, **changes})


# -- the certificate as JSON ------------------------------------------------------------------


def test_a_certificate_survives_its_file(paper_json: Any, tmp_path: Any) -> None:
    """Written, read and checked again, it says the same; the gain is the same doubles."""
    path = tmp_path / "certificate.json"
    path.write_text(json.dumps(paper_json), encoding="utf-8")
    data = read_certificate(path)
    assert data == paper_json
    certificate = check_certificate(data)
    assert certificate.valid
    assert certificate.claim == paper_json["claim"]


def _leaves(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        if isinstance(value, dict | list):
            yield from _leaves(value, (*path, key))
        else:
            yield (*path, key)


def _changed(data: Any, path: tuple[Any, ...], change: Callable[[Any], Any]) -> Any:
    result = copy.deepcopy(data)
    place = result
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = change(place[path[-1]])
    return result


def _refused(data: Any) -> bool:
    try:
        return not check_certificate(data).valid
    except InputError:
        return True


def _much_worse(value: Any) -> Any:
    """A well-formed value of the same kind under which the claim is false or unproved."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, float):
        return value + 1000.0
    try:
        return str(-Fraction(value) * 1000 - 7)
    except ValueError:
        return f"{value} and more"


def test_every_entry_counts(paper_json: Any) -> None:
    """A well-formed change of any single entry that breaks the proof is refused."""
    leaves = [path for path in _leaves(paper_json) if path != ("system", "name")]
    assert {path[0] for path in leaves} == {"claim", "system", "variables", "K"}
    accepted = [path for path in leaves if not _refused(_changed(paper_json, path, _much_worse))]
    assert accepted == []


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "garbage",
    [
        None,
        [],
        {},
        "",
        "nan",
        "1/0",
        "1e5",
        "1e999999999",
        " 1",
        "1.5",
        "9" * (MAX_DIGITS + 1),
        "1/" + "9" * (MAX_DIGITS + 1),
        "1/" + "3" * 41,
        float("nan"),
        float("inf"),
        10**5000,
        [[10**5000]],
        "\u0661",
    ],
    ids=lambda x: str(x)[:12] if not isinstance(x, int | list) else f"{type(x).__name__}",
)
def test_garbage_in_any_place_is_refused_at_once(paper_json: Any, garbage: Any) -> None:
    """What is no number, or one too long, is bad input wherever it stands; nothing hangs."""
    places = [path for path in _leaves(paper_json) if path != ("system", "name")]
    places += [("variables", key) for key in paper_json["variables"]]
    places += [("system", key) for key in paper_json["system"]]
    places += [(key,) for key in paper_json]
    for path in places:
        if path == ("system", "name") and isinstance(garbage, str):
            continue  # a name is any text, and nothing is claimed about it
        assert _refused(_changed(paper_json, path, lambda _: garbage)), path


def test_a_missing_key_is_named(paper_json: Any) -> None:
    """Every key is needed: in the certificate, among the variables, in the claim."""
    for path in [(key,) for key in paper_json] + [
        ("variables", k) for k in paper_json["variables"]
    ]:
        data = copy.deepcopy(paper_json)
        del (data[path[0]] if len(path) == 2 else data)[path[-1]]
        with pytest.raises(InputError, match=path[-1]):
            check_certificate(data)
    for key in paper_json["claim"]:
        data = copy.deepcopy(paper_json)
        del data["claim"][key]
        assert _refused(data)


def test_symmetry_and_the_product_with_the_deployed_gain_are_exact(paper_json: Any) -> None:
    """A difference of 2^-200 in X, Y, Q or R off the diagonal, or one bit of K, is seen."""

    def nudged(text: str) -> str:
        return str(Fraction(text) + Fraction(1, 2**200))

    for path, reason in (
        (("variables", "X", 0, 1), "X is not symmetric"),
        (("variables", "Q", 0, 0, 1), "Q[0] is not symmetric"),
        (("variables", "R", 0, 1, 0), "R[0] is not symmetric"),
        (("variables", "Y", 0, 0), "Y is not K X"),
    ):
        assert check_certificate(_changed(paper_json, path, nudged)).reason == reason
    bit = _changed(paper_json, ("K", 0, 0), lambda k: float(np.nextafter(k, 1)))
    assert check_certificate(bit).reason == "Y is not K X"
    lower = _changed(
        paper_json, ("claim", "gamma"), lambda g: str(Fraction(g) - Fraction(1, 2**60))
    )
    assert "claim" in str(check_certificate(lower).reason)


def test_a_gain_is_not_waved_through_where_there_is_no_input() -> None:
    """Without an input the only gain is the empty one; any other in the file is refused."""
    _, K, v = _solved(_benchmark(1.0), (0.0,), (0.2,), None)
    data = certificate_to_json(_benchmark(1.0), K, v)
    assert data["K"] == []
    data["K"] = [[1.0, 2.0]]
    with pytest.raises(InputError, match="K"):
        check_certificate(data)


def test_an_enormous_system_is_refused_before_the_work() -> None:
    """A file of many delays would take hours: it is refused by its number of rows."""
    N = 200
    one = {"d": 1.0, "A": [[0.0]]}
    variables = {
        "X": [["1"]],
        "Y": [],
        "Q": [[["1"]]] * N,
        "R": [[["1"]]] * N,
        "eps": None,
        "k1": ["0"] * N,
        "k2": ["1"] * N,
        "gamma": None,
    }
    said = {"d": 1.0, "age": "constant, up to d", "feedback": False}
    claim = {
        "property": "stability",
        "gamma": None,
        "delays": [said] * N,
        "uncertain": False,
        "inputs": "doubles",
    }
    system = {"A": [[-1.0]], "delays": [one] * N}
    data = {"claim": claim, "system": system, "variables": variables, "K": []}
    with pytest.raises(InputError, match="too large"):
        check_certificate(data)


@pytest.mark.parametrize("text", ["", "{", "[1,", '{"K": ' + "9" * 5000 + "}", "[" * 100_000])
def test_a_file_that_is_no_json_is_bad_input(tmp_path: Any, text: str) -> None:
    """Malformed, endless or too deep: the message names the file."""
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"broken\.json"):
        read_certificate(path)


def test_bytes_that_are_no_text_are_bad_input(tmp_path: Any) -> None:
    """So are a file that is not UTF-8, one that does not exist, and data that is no object."""
    path = tmp_path / "broken.json"
    path.write_bytes(b"\xff\xfe\x00")
    for place in (path, tmp_path / "none.json"):
        with pytest.raises(InputError):
            read_certificate(place)
    with pytest.raises(InputError):
        check_certificate([1, 2])


# -- the proof of definiteness -----------------------------------------------------------------


def _lower(rows: list[list[Fraction]]) -> list[list[Any]]:
    exactly = [[flint.fmpq(x.numerator, x.denominator) for x in row] for row in rows]
    return [row[: i + 1] for i, row in enumerate(exactly)]


def test_definiteness_is_decided_beyond_every_double() -> None:
    """2^-300 on either side of singular, and the Hilbert matrix of order 20 (condition 1e28)."""
    one, tiny = Fraction(1), Fraction(1, 2**300)
    assert first_bad_pivot(_lower([[one, one], [one, one + tiny]])) is None
    assert first_bad_pivot(_lower([[one, one], [one, one - tiny]])) == 1
    assert first_bad_pivot(_lower([[one, one], [one, one]])) == 1
    assert first_bad_pivot(_lower([[0 * one, one], [one, one]])) == 0
    hilbert = [[Fraction(1, i + j + 1) for j in range(20)] for i in range(20)]
    assert first_bad_pivot(_lower(hilbert)) is None
    hilbert[19][19] -= Fraction(1, 10**20)
    assert first_bad_pivot(_lower(hilbert)) == 19


def test_definiteness_agrees_with_leading_minors() -> None:
    """Sylvester's criterion with exact determinants, on matrices of small integers."""
    rng = np.random.default_rng(3)
    outcomes = set()
    for _ in range(200):
        n = int(rng.integers(1, 6))
        G = rng.integers(-2, 3, (n, n))
        M = G @ G.T + int(rng.integers(-1, 2)) * np.eye(n, dtype=int)
        minors = [flint.fmpz_mat(M[:k, :k].tolist()).det() for k in range(1, n + 1)]
        bad = first_bad_pivot(_lower([[Fraction(int(x)) for x in row] for row in M]))
        first = next((k for k, minor in enumerate(minors) if minor <= 0), None)
        assert bad == first
        outcomes.add(bad is None)
    assert outcomes == {True, False}


def test_numbers_are_read_as_written() -> None:
    """Fractions, signs and unreduced ones are what they say."""
    for text in ("0", "-3", "101/20", "-4/6", "1/" + str(2**1074)):
        value = from_text(text, "here")
        assert Fraction(int(value.p), int(value.q)) == Fraction(text)


# -- soundness ---------------------------------------------------------------------------------


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


def test_what_is_proved_is_true_of_random_loops() -> None:
    """Proved loops are stable with a norm below gamma, for random F and delays up to d."""
    rng = np.random.default_rng(2)
    proved = 0
    for trial in range(24):
        system = _random_system(
            rng, late=bool(trial % 2), any_age=bool(trial // 2 % 2), uncertain=True, scale=0.4
        )
        gamma = float(np.linalg.norm(system.D1, 2)) + float(rng.uniform(0.3, 3.0))
        k = (0.3 / system.delays[0].d, 0.3 / system.delays[1].d)
        _, K, v = _solved(system, (-k[0], -k[1]), k, gamma)
        if not certify(system, K, v).valid:
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
    assert proved >= 6
