"""A design is refused only where no route certifies one; what is claimed is the best proof."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from broken_solvers import break_all
from cli.shell import cosim
from shared import sampled, share_of
from truth_of_loops import loop_of, norm
from varied_systems import FRIDMAN_SHAKED, NOMOTO_SHIP, chain, varied_system

from cosim.core import InputError, NotAchievableError
from cosim.hinf import as_cvxpy, auv_system, check_certificate, design
from cosim.hinf.lmi import Answer, Problem, own_units, scaling_of
from cosim.hinf.problem import DEFAULT_K1, DEFAULT_K2, with_delays
from cosim.hinf.synthesis import (
    clearly_below,
    first_proved,
    least_gamma,
    least_proved,
    levels_above,
    preferred,
)
from cosim.hinf.theorems import Scalars
from cosim.models import paper_example

GRID = [float(x) for x in np.geomspace(0.02, 20.0, 20)]
"""k2 d, and -k1 / k2, of the grid over which cvxpy is asked."""


def test_a_classical_benchmark_needs_no_hints() -> None:
    """Without k1, k2 or an order: below every published value (0.11 and more)."""
    found = design(FRIDMAN_SHAKED)
    assert found.gamma is not None
    assert norm(loop_of(FRIDMAN_SHAKED, found.K)) < found.gamma <= 0.1095
    assert check_certificate(found.certificate).valid


def test_theorem_2_alone_proves_it_where_the_search_ends_at_an_unbounded_gain() -> None:
    """The least gamma tends to 0.25 as the gain grows without bound; twice that is proved."""
    found = design(FRIDMAN_SHAKED, order=None)
    assert found.order is None
    assert found.gamma is not None
    assert found.gamma < 0.63


def test_a_limit_on_the_gain_uses_the_same_ladder() -> None:
    """|K| = 7.55 exists at a limit of 10."""
    found = design(FRIDMAN_SHAKED, gain_limit=10.0)
    assert np.linalg.norm(found.K, 2) <= 10.0
    assert found.guarantees.gain_limit is not None
    assert check_certificate(found.certificate).valid


@pytest.mark.parametrize("seed", sampled([8, 10, 27], 1))
def test_a_limit_just_above_the_gain_of_a_design_is_met(seed: int) -> None:
    """What is certified without the limit meets it: it is never refused with it."""
    system = varied_system(seed)
    free = design(system)
    limit = 1.02 * float(np.linalg.norm(free.K, 2))
    found = design(system, gain_limit=limit)
    assert np.linalg.norm(found.K, 2) <= limit
    assert found.guarantees.gain_limit is not None
    assert check_certificate(found.certificate).valid


@pytest.mark.slow
@pytest.mark.parametrize("seed", share_of([7, 20, 28]))
def test_odd_units_and_narrow_margins(seed: int) -> None:
    """States in odd units, and one whose LMI with gamma has no point that can be proved."""
    system = varied_system(seed)
    found = design(system)
    assert found.gamma is not None
    assert norm(loop_of(system, found.K)) < found.gamma < 2.0 * (found.exact_norm or 0.0)
    assert check_certificate(found.certificate).valid


def test_the_time_of_a_loop_does_not_depend_on_units() -> None:
    """States in units of a thousand and a thousandth: the same unit of time, within balancing."""
    A, S = np.array([[-1.0, 2.0], [0.5, -3.0]]), np.array([1e3, 1e-3])
    times = [own_units([M])[1] for M in (A, S[:, None] * A / S)]
    assert 0.5 < times[0] / times[1] < 2.0


def test_units_that_hardly_solve_are_not_kept() -> None:
    """Where balanced units fail and the others find only an inaccurate point, the first return."""
    system = varied_system(28)
    problem = Problem(system)
    usual, delays = problem.scaling, tuple(x.d for x in system.delays)
    k2 = tuple(1.0 / d for d in delays)
    poor = problem.least_gamma(Scalars(tuple(-0.2 * k for k in k2), k2, delays))
    assert not (isinstance(poor, Answer) and poor.accurate)
    assert problem.scaling is usual


@pytest.mark.slow
def test_the_vehicle_over_three_seconds(tmp_path: Path) -> None:
    """The solver fails at the k1, k2 of the file; a search from there certifies a gain."""
    late = ("design", "auv", "--delays", "0.5,3.0", "--json")
    assert cosim(*late, cwd=tmp_path).json["gamma"] < 75.0


@pytest.mark.parametrize("order", sampled([0, "auto", None, 1], 1))
def test_a_ship_by_every_condition(order: Any) -> None:
    """Nomoto's ship, slow against its delay, where w acts weakly: no order refuses it."""
    found = design(NOMOTO_SHIP, order=order)
    assert found.gamma is not None
    assert norm(loop_of(NOMOTO_SHIP, found.K)) < found.gamma < 4.8
    assert check_certificate(found.certificate).valid


@pytest.mark.parametrize("n", sampled([8, 12, 16, 20, 24], 1))
def test_a_long_chain_is_certified(n: int) -> None:
    """No accurate answer in balanced units, which spread over many decades, but in its own."""
    system = chain(n)
    k1, k2 = (-2.5,), (2.5,)
    balanced = Problem(system, scaling=scaling_of(system))
    p = Scalars(k1, k2, (0.1,))
    poor = balanced.least_gamma(p)
    assert not (isinstance(poor, Answer) and poor.accurate)
    found = design(system, k1, k2, order=None, search=False)
    assert found.gamma is not None
    assert found.least_gamma is not None
    assert found.exact_norm is not None
    assert found.exact_norm < found.gamma < 1.001 * found.least_gamma
    assert check_certificate(found.certificate).valid


def test_a_design_analyses_its_own_gain() -> None:
    """The vehicle: 3.4187 by Theorem 2, 3.3624 for the same gain by Theorem 1."""
    plain = design(auv_system(), DEFAULT_K1, DEFAULT_K2, order=None)
    found = design(auv_system(), DEFAULT_K1, DEFAULT_K2)
    assert found.K.tolist() == plain.K.tolist()
    assert plain.gamma is not None
    assert found.gamma is not None
    assert found.gamma < 3.364 < plain.gamma
    assert found.covers_smaller_delays
    assert check_certificate(found.certificate).valid


@pytest.mark.slow
def test_a_search_of_the_vehicle_spends_few_solves() -> None:
    """Below 3.41 within 40 solves, of which each takes a quarter of a second."""
    system = auv_system()
    problem = Problem(system)
    p = Scalars(DEFAULT_K1, DEFAULT_K2, tuple(x.d for x in system.delays))
    passed = least_gamma(problem, p)
    assert passed[0][1].value < 3.41
    assert problem.solve_count <= 40
    values = [answer.value for _, answer in passed]
    assert values == sorted(values)


def test_cvxpy_is_a_solver_of_its_own() -> None:
    """The same LMI at the same k1, k2: the same gamma; with a limit or an order it is refused."""
    system = paper_example.system()
    own = design(system, (0.6,), (0.2,), order=None, search=False)
    other = design(system, (0.6,), (0.2,), solver="cvxpy")
    assert other.gamma == pytest.approx(own.gamma, rel=1e-3)
    assert check_certificate(other.certificate).valid
    with pytest.raises(InputError, match="solver"):
        design(system, solver="cvxpy", gain_limit=2.0)


def test_an_unknown_order_is_refused(tmp_path: Path) -> None:
    """A word that names no condition: what it may be."""
    error = cosim("design", "paper", "--order", "best", "--json", cwd=tmp_path).error
    assert (error["where"], error["exit_code"]) == ("--order", 2)
    assert "theorem-2" in error["expected"]


def test_the_error_names_every_route(monkeypatch: pytest.MonkeyPatch) -> None:
    """A solver that always fails: its failure is called that, and the routes are listed."""
    break_all(monkeypatch, "NumericalError")
    with pytest.raises(NotAchievableError) as refused:
        design(FRIDMAN_SHAKED, alternatives=False)
    text = str(refused.value)
    assert "the solver failed" in text
    for route in ("order 1", "order 2", "cvxpy"):
        assert route in text


def test_proofs_of_smaller_delays_are_preferred() -> None:
    """A proof of exactly these delays must be a tenth lower to be claimed instead."""
    found = design(paper_example.system(), (0.6,), (0.2,), order=None, search=False)
    assert found.gamma is not None
    for share, preferred_one in ((0.95, 0), (0.85, 1)):
        exactly: Any = SimpleNamespace(
            gamma=share * found.gamma, abscissa=found.abscissa, covers_smaller_delays=False
        )
        both: list[Any] = [found, exactly]
        assert preferred(both) is both[preferred_one]


def test_the_ladder() -> None:
    """Levels rise; the first proved ends it; the last reason is kept."""
    levels = levels_above(2.0, (0.0, 0.5, 9.0))
    assert levels == [2.0, 3.0, 20.0]
    assert first_proved(levels, lambda x: (x if x > 2 else None, f"not {x}")) == (3.0, "")
    assert first_proved(levels, lambda x: (None, f"not {x}")) == (None, "not 20.0")


def test_no_fruitless_proofs() -> None:
    """What fails near its least gamma and far from it is not tried in between."""
    levels = [float(x) for x in range(1, 8)]
    for first in range(1, 9):
        tried: list[float] = []

        def prove(level: float, first: int = first, tried: list[float] = tried) -> Any:
            tried.append(level)
            return level if level >= first else None, f"not {level}"

        found, reason = least_proved(levels, prove)
        assert (found, reason) == (((first, first), "") if first < 8 else (None, "not 7.0"))
        assert len(tried) <= (3 if first == 8 else first + (first > 2))
        assert len(set(tried)) == len(tried)
    assert clearly_below(levels, None) == levels
    assert clearly_below(levels, 3.0) == [1.0, 2.0]
    assert clearly_below([2.9999], 3.0) == []


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", share_of(range(200)))
def test_no_system_is_refused_that_some_route_certifies(seed: int) -> None:
    """Systems of varied shape: one that is refused has no solution over a grid of k1, k2."""
    system = varied_system(seed)
    try:
        found = design(system, alternatives=False)
    except NotAchievableError:
        assert not certified_over_grid(system)
        return
    assert found.gamma is not None
    assert check_certificate(found.certificate).valid
    assert norm(loop_of(system, found.K)) <= found.gamma


def certified_over_grid(system: Any) -> bool:
    """Whether the plain LMI in cvxpy leads to a proof at any k1, k2 of a 20 x 20 grid."""
    lengths = [x.d or 1.0 for x in system.delays]
    for scale in GRID if lengths else GRID[:1]:
        for ratio in GRID if lengths else GRID[:1]:
            k2 = tuple(scale / d for d in lengths)
            lmi = as_cvxpy(system, tuple(-ratio * x for x in k2), k2)
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # the proof judges an inaccurate point
                    lmi.problem.solve(solver=cp.CLARABEL)
                if lmi.X.value is not None and lmi.design().certified:
                    return True
            except (cp.SolverError, NotAchievableError, InputError):
                continue
    return False


@pytest.mark.slow
def test_other_delays_of_the_same_system() -> None:
    """A refusal with a reason is still a refusal: no gain stabilises across ten seconds."""
    with pytest.raises(NotAchievableError, match="nor by"):
        design(with_delays(FRIDMAN_SHAKED, [30.0]), gamma=0.01, alternatives=False)
