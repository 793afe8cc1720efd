"""Algebraic loops that are iterated at every point, against their closed solution."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scalar import scalar_fmu, scalars

from cosim.master import EngineName, Session, simulate

ENGINES: tuple[EngineName, ...] = ("kernel", "python")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


def loop(fmu: Path, gains: tuple[float, float], **more: Any) -> Any:
    """y1 = x1 + e1 y2, y2 = x2 + e2 y1: both outputs depend on the other at once."""
    given = {
        "a": {"a": -1.0, "b": 0.5, "x0": 1.0, "e": gains[0]},
        "b": {"a": -0.5, "b": -0.8, "x0": -0.5, "e": gains[1]},
    }
    pairs = (("a.y", "b.u"), ("b.y", "a.u"))
    return scalars(fmu, given, pairs, step=0.1, stop=2.0, solve=True, **more)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("gains", [(0.5, -0.8), (0.9, 0.95), (-0.3, 0.0)])
def test_rows_solve_the_equations_of_the_loop(
    fmu: Path, engine: EngineName, gains: tuple[float, float]
) -> None:
    run = simulate(loop(fmu, gains, solve_limit=1000), engine=engine)
    assert run.status == "finished"
    x1, x2 = run.signal("a", "x"), run.signal("b", "x")
    determinant = 1.0 - gains[0] * gains[1]
    y1 = (x1 + gains[0] * x2) / determinant
    y2 = (x2 + gains[1] * x1) / determinant
    assert np.allclose(run.signal("a", "y"), y1, rtol=0, atol=1e-8)
    assert np.allclose(run.signal("b", "y"), y2, rtol=0, atol=1e-8)
    assert np.allclose(run.signal("b", "u"), y1, rtol=0, atol=1e-8)
    assert np.allclose(run.signal("a", "u"), y2, rtol=0, atol=1e-8)
    # the states follow the held inputs, exactly
    following = np.exp(-0.1) * x1[:-1] - np.expm1(-0.1) * 0.5 * run.signal("a", "u")[:-1]
    assert np.allclose(x1[1:], following, rtol=0, atol=1e-12)


def test_both_engines_take_the_same_passes(fmu: Path) -> None:
    one, other = (simulate(loop(fmu, (0.9, 0.95), solve_limit=1000), engine=e) for e in ENGINES)
    assert one.instances[0].rows.tobytes() == other.instances[0].rows.tobytes()


@pytest.mark.parametrize("engine", ENGINES)
def test_loop_that_grows_beyond_a_gain_of_one_later_is_named(fmu: Path, engine: EngineName) -> None:
    with Session(loop(fmu, (0.5, -0.8)), engine=engine) as session:
        session.run_until(0.5)
        session.bias("a", "u", 0.0, factor=3.0)  # the gain is -1.2 from now on
        session.go_on()
        run = session.result()
    assert run.status == "failed"
    assert run.reason is not None
    assert "does not settle at t = 0.5 s" in run.reason
    assert run.points_ns.tolist() == [10**8 * k for k in range(5)]


@pytest.mark.parametrize("engine", ENGINES)
def test_limit_ends_the_run_with_the_loop_and_the_signal(fmu: Path, engine: EngineName) -> None:
    run = simulate(loop(fmu, (0.5, -0.8), solve_limit=5), engine=engine)
    assert run.status == "failed"
    assert run.reason is not None
    assert "does not settle at t = 0 s" in run.reason
    assert "a -> b -> a" in run.reason
    assert "run.solve_limit" in run.reason
    assert run.points_ns.size == 0


@pytest.mark.parametrize("engine", ENGINES)
def test_loop_among_others_and_with_own_steps(fmu: Path, engine: EngineName) -> None:
    given = {
        "c": {"x0": 2.0, "e": 0.0},
        "a": {"x0": 1.0, "e": 0.4},
        "b": {"x0": -0.5, "e": 0.6},
        "d": {"x0": 0.0, "e": 2.0},
    }
    pairs = (("a.y", "b.u"), ("b.y", "a.u"), ("b.y", "d.u"))
    system = scalars(fmu, given, pairs, step=0.1, stop=2.0, solve=True, every={"c": 0.3, "d": 0.2})
    run = simulate(system, engine=engine)
    assert run.status == "finished"
    x1, x2 = run.signal("a", "x"), run.signal("b", "x")
    y2 = (x2 + 0.6 * x1) / (1.0 - 0.24)
    assert np.allclose(run.signal("b", "y"), y2, rtol=0, atol=1e-8)
    own = slice(0, None, 2)
    d = run.signal("d", "x")[own] + 2.0 * run.signal("b", "y")[own]
    assert np.allclose(run.signal("d", "y")[own], d, rtol=0, atol=1e-12)
