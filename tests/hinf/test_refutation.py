"""Proofs that something cannot be had: sound, rejected when changed, and there where due."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import flint
import numpy as np
import pytest
from cli.shell import cosim
from numpy.typing import NDArray
from solver_points import benchmark, random_system

from cosim.core import InputError, NotAchievableError
from cosim.fmu.export import export_controller
from cosim.hinf import auv_system, check_certificate, design, greatest_delay
from cosim.hinf.certificate import Place, conditions, fixed_at, gamma_floor
from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi import Answer, Problem, in_cvxpy, refute
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2, with_delays
from cosim.hinf.synthesis import delay_by_theorem_2
from cosim.hinf.theorems import Scalars, minus_omega, products, rates_from_rows, shapes_of
from cosim.models import Delay, DelaySystem, paper_example

Array = NDArray[np.float64]


def _place(p: Scalars, gamma: float | None) -> Place:
    return Place(
        tuple(map(exact, p.k1)), tuple(map(exact, p.k2)), None if gamma is None else exact(gamma)
    )


def _refuted(system: DelaySystem, k1: Any, k2: Any, gamma: float | None) -> dict[str, Any] | None:
    p = Scalars(k1, k2, tuple(delay.d for delay in system.delays))
    found = refute(system, Problem(system), p, gamma)
    return None if found is None else json.loads(json.dumps(found))


def _matrix(rows: list[list[str]], unit: Fraction) -> Array:
    return np.array([[float(Fraction(x) / unit) for x in row] for row in rows])


@pytest.mark.parametrize("case", range(8))
def test_multipliers_leave_one_constant_of_the_reference_lmi(case: int) -> None:
    """<Z, -Omega> + <Z_X, X> + <Z_Q, Q> by `omega`: the same c <= 0 at any unknowns whatever."""
    rng = np.random.default_rng(40 + case)
    late, any_age = bool(case & 1), bool(case & 2)
    system = random_system(rng, late=late, any_age=any_age, uncertain=bool(case & 4))
    k1, k2 = (-0.5, -0.5), (0.7, 0.9)
    proof = _refuted(system, k1, k2, 0.05 * np.linalg.norm(system.D1, 2))
    assert proof is not None
    assert check_certificate(proof).valid
    gamma = float(Fraction(proof["at"]["gamma"]))
    multipliers = proof["multipliers"]
    unit = max(abs(Fraction(x)) for row in multipliers["Z"] for x in row)
    Z, n = _matrix(multipliers["Z"], unit), 2
    at = [exact(x) for x in k1], [exact(x) for x in k2]
    form = minus_omega(system, *at, bounded=True)
    G = rates_from_rows(system, form)
    back = np.linalg.inv(np.reshape([float(flint.fmpq(x)) for x in G.entries()], Z.shape))
    Z = back @ Z @ back.T  # of rows s_j

    def value(scale: float) -> tuple[float, float]:
        def sym() -> Array:
            M = scale * rng.standard_normal((n, n))
            return M + M.T

        X, R, Y = sym(), (sym(), sym()), scale * rng.standard_normal((1, n))
        Q = tuple(np.zeros((n, n)) if x.any_age else sym() for x in system.delays)
        eps = scale * float(rng.standard_normal())
        v = {"X": X, "Y": Y, "eps[0]": eps, "gamma": gamma}
        v |= {f"{name}[{j}]": M for name, each in (("Q", Q), ("R", R)) for j, M in enumerate(each)}
        whole = in_cvxpy(form, v)
        parts = [np.vdot(Z, whole), np.vdot(_matrix(multipliers["X"], unit), X)]
        parts += [
            np.vdot(_matrix(own, unit), M)
            for own, M in zip(multipliers["Q"], Q, strict=True)
            if own is not None
        ]
        return float(sum(parts)), float(np.linalg.norm(Z) * np.linalg.norm(whole))

    c, _ = value(0.0)
    assert c < 0
    for _ in range(5):
        there, size = value(1.0)
        assert there == pytest.approx(c, abs=1e-12 * size)


@pytest.mark.parametrize("case", range(16))
def test_refutes_far_from_feasible_and_never_feasible_systems(case: int) -> None:
    """Random systems at half and at twice the least gamma of their LMI."""
    rng = np.random.default_rng(100 + case)
    system = random_system(
        rng, late=bool(case & 1), any_age=bool(case & 2), uncertain=bool(case & 4), scale=0.3
    )
    k1, k2 = (-0.5, -0.5), (0.7, 0.9)
    p = Scalars(k1, k2, tuple(delay.d for delay in system.delays))
    problem = Problem(system)
    least = problem.least_gamma(p)
    if not isinstance(least, Answer):
        # no gamma at all: not even stability, which is the same LMI without rows w and z
        bare = DelaySystem(
            system.A,
            system.B,
            E=system.E if case & 4 else None,
            H=system.H if case & 4 else None,
            delays=system.delays,
        )
        assert _refuted(bare, k1, k2, None) is not None
        return
    assert _refuted(system, k1, k2, 2 * least.value) is None
    proof = _refuted(system, k1, k2, 0.5 * least.value)
    assert proof is not None
    assert check_certificate(proof).valid


def test_a_published_benchmark_without_w_and_z() -> None:
    """k1 = -.1, k2 = .2: certified at its end, refuted just above, both short of the truth."""
    found = delay_by_theorem_2(benchmark(1.0), None, (-0.1,), (0.2,))
    assert found.refuted_at is not None
    assert found.delay < found.refuted_at < 6.172581371
    proof = check_certificate(found.refutation)
    assert proof.valid
    assert proof.claim["gamma"] is None


@pytest.mark.slow
def test_the_vehicle_is_refuted_just_above_its_greatest_delay() -> None:
    """58 rows, 141 equalities: exact all the same."""
    found = greatest_delay(auv_system(), 5.0, DEFAULT_K1, DEFAULT_K2, delay_index=1)
    assert found.refuted_at is not None
    assert found.delay < found.refuted_at < 1.001 * found.delay
    assert check_certificate(found.refutation).valid


def test_a_gamma_below_the_least_is_refused_with_its_proof() -> None:
    """Section 5 at k1 = .6, k2 = .2: 5.01 < 5.0132."""
    with pytest.raises(NotAchievableError, match="cannot be reached") as refused:
        design(paper_example.system(), (0.6,), (0.2,), gamma=5.01, order=None, alternatives=False)
    proof = check_certificate(refused.value.certificate)
    assert proof.valid
    assert Fraction(proof.claim["gamma"]) == Fraction(5.01)


def test_k1_k2_without_a_feasible_delay_are_refused_with_their_proof() -> None:
    """k2 < 0: not even at twenty microseconds."""
    with pytest.raises(NotAchievableError, match="any delay") as refused:
        greatest_delay(paper_example.system(), 6.0, (5.0,), (-1.0,))
    assert check_certificate(refused.value.certificate).valid


def _entries_that_count(system: DelaySystem) -> set[tuple[int, int]]:
    """Entries of Z where Omega depends on an unknown; the others multiply nothing."""
    place = _place(Scalars((0.6,), (0.2,), ()), 6.0)
    form, *others = conditions(system, place)
    size = sum(form.rows.values())
    none = [flint.fmpq_mat(2, 2) for _ in others]

    def counts(i: int, j: int) -> bool:
        Z = flint.fmpq_mat(size, size)
        Z[i, j] = Z[j, i] = 1
        left, _ = products([form, *others], [Z, *none], fixed_at(place))
        return any(C != 0 * C for C in left.values())

    return {(i, j) for i in range(size) for j in range(i + 1) if counts(i, j)}


def test_changing_any_entry_invalidates_the_proof() -> None:  # noqa: C901 - one change after the other
    """One multiplier, k1, k2, gamma, delay or matrix entry changed: not proved."""
    proof = _refuted(with_delays(paper_example.system(), [1.06]), (0.6,), (0.2,), 6.0)
    assert proof is not None

    def fails(change: Callable[[dict[str, Any]], None]) -> bool:
        changed = copy.deepcopy(proof)
        change(changed)
        return not check_certificate(changed).valid

    for i, j in _entries_that_count(with_delays(paper_example.system(), [1.06])):

        def bump(data: dict[str, Any], i: int = i, j: int = j) -> None:
            rows = data["multipliers"]["Z"]
            rows[i][j] = rows[j][i] = str(Fraction(rows[i][j]) * Fraction(11, 10) + 1)

        assert fails(bump), (i, j)
    for name in ("X", "Q"):

        def grow(data: dict[str, Any], name: str = name) -> None:
            rows = data["multipliers"][name]
            rows = rows if name == "X" else rows[0]
            rows[0][0] = str(Fraction(rows[0][0]) + 1)

        assert fails(grow)
    assert fails(lambda data: data["multipliers"]["Z"][0].__setitem__(1, "0"))
    for key in ("k1", "k2"):

        def move(data: dict[str, Any], key: str = key) -> None:
            data["at"][key] = data["claim"][key] = [str(Fraction(data["at"][key][0]) / 2)]

        assert fails(move)
    nought = copy.deepcopy(proof)  # where the LMI is no longer that of the theorem
    nought["at"]["k2"] = nought["claim"]["k2"] = ["0"]
    assert check_certificate(nought).reason == "a k2 is 0"

    def tenfold(data: dict[str, Any]) -> None:
        data["at"]["gamma"] = data["claim"]["gamma"] = "60"

    assert fails(tenfold)

    def shorter(data: dict[str, Any]) -> None:
        data["system"]["delays"][0]["d"] = data["claim"]["delays"][0]["d"] = 1.0

    assert fails(shorter)
    for key in ("A", "B", "C", "D", "D1", "D2", "E", "H"):
        other = -20.0 if key in {"C", "D1"} else 7.5  # these two enter the constant alone
        assert fails(lambda d, k=key, x=other: d["system"][k][0].__setitem__(0, x)), key
    assert fails(lambda data: data["claim"].__setitem__("property", "more"))
    assert not fails(lambda data: data.__setitem__("note", "not part of the claim"))


def test_zero_multipliers_prove_nothing() -> None:
    """All zero meets every equality, and leaves c = 0."""
    proof = _refuted(with_delays(paper_example.system(), [1.06]), (0.6,), (0.2,), 6.0)
    assert proof is not None
    for name, size in (("Z", 11), ("X", 2)):
        proof["multipliers"][name] = [["0"] * size] * size
    proof["multipliers"]["Q"] = [[["0"] * 2] * 2]
    assert not check_certificate(proof).valid


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data.pop("at"),
        lambda data: data["at"].pop("gamma"),
        lambda data: data["at"].__setitem__("gamma", None),
        lambda data: data["at"].__setitem__("k1", []),
        lambda data: data["multipliers"].__setitem__("Q", [None]),
        lambda data: data["multipliers"].__setitem__("Z", [["1"]]),
        lambda data: data["multipliers"]["Z"][0].__setitem__(0, "1/0"),
        lambda data: data["multipliers"]["Z"][0].__setitem__(0, 1.5),
        lambda data: data.__setitem__("kind", ["refutation"]),
        lambda data: data.__setitem__("system", 3),
    ],
)
def test_malformed_refutation_is_bad_input(damage: Callable[[dict[str, Any]], Any]) -> None:
    """Missing keys, wrong shapes, wrong numbers: named, never a traceback."""
    proof = _refuted(with_delays(paper_example.system(), [1.06]), (0.6,), (0.2,), 6.0)
    assert proof is not None
    damage(proof)
    with pytest.raises(InputError):
        check_certificate(proof)


def test_the_products_are_those_of_the_inequalities() -> None:
    """At random unknowns and multipliers <W, -Omega> + <Z, X> + .. is the sum over the unknowns."""
    rng = np.random.default_rng(3)

    def drawn(height: int, width: int) -> Any:
        whole = exact_matrix(np.round(rng.standard_normal((height, width)), 3))
        return whole + whole.transpose() if height == width else whole

    system = random_system(rng, late=True, any_age=False, uncertain=True)
    inequalities = conditions(system, _place(Scalars((-0.5, 0.25), (0.75, 1.5), ()), 3.0))
    values = {"gamma": flint.fmpq(3)}
    for name, shape in shapes_of(inequalities).items():
        whole = drawn(shape.height, shape.width)
        values.setdefault(name, whole[0, 0] if shape.is_number else whole)
    multipliers = [drawn(*[sum(one.rows.values())] * 2) for one in inequalities]
    total = flint.fmpq(0)
    for one, W in zip(inequalities, multipliers, strict=True):
        for i, row in enumerate(one.at(values)):
            total += sum(x * W[i, j] * (1 + (i != j)) for j, x in enumerate(row))
    parts, constant = products(inequalities, multipliers, {"gamma": flint.fmpq(3)})
    for name, C in parts.items():
        U = values[name]
        entries = [U] if isinstance(U, flint.fmpq) else U.entries()
        constant += sum(a * b for a, b in zip(C.entries(), entries, strict=True))
    assert constant == total


@pytest.mark.parametrize("gamma", [4.0, 5.0])
def test_gamma_up_to_that_of_d1_is_proved_impossible(gamma: float) -> None:
    """Table 2's first two rows: |D1|^2 = 25 >= gamma^2, for every delay, k1, k2 and K."""
    with pytest.raises(NotAchievableError, match=r"\|\|D1\|\|") as refused:
        greatest_delay(paper_example.system(), gamma, (0.6,), (0.2,), search=True)
    data = json.loads(json.dumps(refused.value.certificate))
    assert check_certificate(data).valid
    above = copy.deepcopy(data)
    above["gamma"] = above["claim"]["gamma"] = "5000000000000001/1000000000000000"
    assert not check_certificate(above).valid
    assert not check_certificate({**data, "w": ["0"]}).valid
    assert not check_certificate({**data, "gamma": "-5"}).valid
    with pytest.raises(InputError):
        check_certificate({**data, "w": "1"})
    with pytest.raises(InputError):
        check_certificate({**data, "w": ["1", "0"]})


def test_the_floor_of_a_matrix_d1() -> None:
    """||[[1, 2], [3, 4]]|| = 5.4650 (closed form): below it proved, above it not."""
    D1 = [[1.0, 2.0], [3.0, 4.0]]
    system = DelaySystem([[-1.0]], C=[[1.0, 1.0]], D=[[1.0], [0.0]], D1=D1)
    norm = np.sqrt((30 + np.sqrt(900 - 16)) / 2)
    below = gamma_floor(system, norm * (1 - 1e-9))
    assert below is not None
    assert check_certificate(below).valid
    assert gamma_floor(system, norm * (1 + 1e-9)) is None


def test_no_floor_without_d1() -> None:
    """D1 = 0: any positive gamma may be had."""
    system = DelaySystem([[-1.0]], C=[[1.0]], D=[[1.0]], delays=[Delay(0.1, [[0.0]])])
    assert gamma_floor(system, 1e-9) is None


def test_the_verbs_keep_and_check_the_proofs(tmp_path: Path) -> None:
    """--save-refutation beside a greatest delay (exit 0) and beside a refusal (exit 5)."""
    path = tmp_path / "proof.json"

    def answered(*arguments: str) -> tuple[int, Any]:
        result = cosim(*arguments, "--json", cwd=tmp_path)
        return result.code, result.json

    common = ("design", "paper", "--max-delay", "--save-refutation", str(path))
    code, output = answered(*common, "--gamma", "6")
    assert (code, output["refutation"]) == (0, str(path))
    assert output["refuted_at"] > output["delays"][0]
    code, output = answered("certificate", "check", str(path))
    assert (code, output["valid"], output["claim"]["gamma"]) == (0, True, "6")
    code, output = answered(*common, "--gamma", "5")
    assert code == 5
    assert "||D1||" in output["error"]["what"]
    assert str(path) in output["error"]["hint"]
    code, output = answered("certificate", "check", str(path))
    assert (code, output["valid"], output["claim"]["gamma"]) == (0, True, "5")
    data = json.loads(path.read_text(encoding="utf-8"))
    data["gamma"] = data["claim"]["gamma"] = "6"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert answered("certificate", "check", str(path))[0] == 1
    code, output = answered("design", "paper", "--gamma", "4", "--max-delay")
    assert code == 5
    assert "--save-refutation" in output["error"]["hint"]


def test_a_refutation_is_no_gain_to_pack(tmp_path: Path) -> None:
    """It speaks of every K and holds none: refused by name."""
    proof = gamma_floor(paper_example.system(), 5.0)
    with pytest.raises(InputError, match="no gain to pack"):
        export_controller(proof, tmp_path / "Controller.fmu", where="proof.json", kind="python")
