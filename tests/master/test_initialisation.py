"""Initialisation of all slaves together: values are exchanged until none changes."""

from __future__ import annotations

from pathlib import Path

import pytest
from scalar import scalar_fmu, scalars

from cosim.core import ComponentError
from cosim.master import EngineName, Session, simulate


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


@pytest.mark.parametrize("engine", ["python", "kernel"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_loop_of_initial_values_is_solved(fmu: Path, engine: EngineName, algorithm: str) -> None:
    """x_a = 1 + 0.5 x_b, x_b = 2 - 0.4 x_a: x_a = 5/3, x_b = 4/3."""
    parts = {"a": {"x0": 1.0, "g": 0.5}, "b": {"x0": 2.0, "g": -0.4}}
    pairs = (("a.x", "b.u"), ("b.x", "a.u"))
    system = scalars(fmu, parts, pairs, step=0.1, stop=0.2, algorithm=algorithm)
    run = simulate(system, engine=engine)
    assert run.signal("a", "x")[0] == pytest.approx(5 / 3, rel=1e-11)
    assert run.signal("b", "x")[0] == pytest.approx(4 / 3, rel=1e-11)


def test_chain_settles_in_two_passes(fmu: Path) -> None:
    parts = {"a": {"x0": 1.0}, "b": {"g": 2.0}, "c": {"g": 3.0}}
    with Session(
        scalars(fmu, parts, (("a.x", "b.u"), ("b.x", "c.u")), step=0.1, stop=0.2)
    ) as session:
        assert session.initial_passes == 2
        assert session.read("c", "x") == 6.0


def test_values_that_do_not_settle_are_named(fmu: Path) -> None:
    parts = {"a": {"x0": 1.0, "g": 1.1}, "b": {"x0": 2.0, "g": -1.1}}
    with pytest.raises(ComponentError, match="do not settle") as caught:
        simulate(scalars(fmu, parts, (("a.x", "b.u"), ("b.x", "a.u")), step=0.1, stop=0.2))
    assert set(str(caught.value.where).split(", ")) == {"a.u", "b.u"}
