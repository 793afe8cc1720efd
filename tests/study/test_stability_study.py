"""The measured boundary of stability, against the exact delay margin and the certificate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim
from study.deadly import plan, truth

from cosim.hinf import characteristic_roots, system_by_name
from cosim.hinf.delay_lti import close
from cosim.models import Delay, DelaySystem
from cosim.study import (
    boundary,
    draw,
    draw_stability,
    execute_study,
    load_study,
    loop_delay_margin,
    plan_of,
    read_table,
    run_study,
)

PNG = b"\x89PNG"


def executed(
    name: str, native_fmus: Path, out: Path, vary: dict[str, object] | None = None
) -> Path:
    """A built-in study, one axis of it changed if so asked."""
    loaded = load_study(name)
    study, base = loaded.study, loaded.base
    if vary is not None:
        axes = [a.model_copy(update=vary.get(a.column)) for a in study.vary]
        study = study.model_copy(update={"vary": axes})
    execute_study(plan_of(study, base, fmus=str(native_fmus.parent)), out)
    return out


def test_the_loop_delay_margin_is_where_a_root_lies_on_the_axis() -> None:
    """Of section 5 with five times the printed gain: the rightmost root there is imaginary."""
    paper = system_by_name("paper").system
    K = np.array([[3.216, -2.8395]])
    margin = loop_delay_margin(paper, K)
    assert margin == pytest.approx(0.350288, abs=1e-6)
    late = Delay(margin, np.zeros((2, 2)), feedback=True)
    own = Delay(paper.delays[0].d, paper.delays[0].A)
    loop = close(DelaySystem(paper.A, paper.B, delays=(own, late)), K)
    root = max(characteristic_roots(loop), key=lambda s: s.real)
    assert root.real == pytest.approx(0.0, abs=1e-7)
    assert abs(root.imag) > 1.0
    assert loop_delay_margin(paper, K / 5.0) is None  # stable however late


@pytest.mark.slow
def test_the_measured_boundary_is_the_exact_delay_margin_within_the_grid(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Section 5's loop: between two points of the grid, and by its exponents much closer."""
    path = executed("delay-margin", native_fmus, tmp_path)
    table, manifest = read_table(path)
    found = boundary(table, manifest)
    assert found is not None
    assert found.exact_margin == pytest.approx(0.350288, abs=1e-6)
    assert found.agrees is True
    edge = found.edges[0]
    assert (edge.stable_to, edge.unstable_from) == (0.34, 0.36)
    assert found.certified_inside is True
    assert edge.certified_to == 0.06
    assert found.certified_age == 0.07
    columns = table.to_pydict()
    growth = dict(zip(columns["delay"], columns["growth"], strict=True))
    zero = 0.34 + 0.02 * growth[0.34] / (growth[0.34] - growth[0.36])
    assert zero == pytest.approx(found.exact_margin, abs=0.003)
    assert draw_stability(table, manifest, tmp_path / "m.png").read_bytes()[:4] == PNG
    drawn = draw(table, manifest, tmp_path / "g.svg", "growth", ["delay"])
    assert "svg" in drawn.read_text()[:300]


@pytest.mark.slow
def test_the_vehicles_boundary_over_packets_is_its_exact_delay_margin_within_the_grid(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Without loss; and with it the certified region shrinks and stays inside the stable one."""
    few = {"delay": {"linspace": [0.65, 2.65, 6]}, "loss": {"values": [0.0, 0.05, 0.6]}}
    path = executed("delay-loss", native_fmus, tmp_path, {**few, "seed": {"count": 1}})
    table, manifest = read_table(path)
    found = boundary(table, manifest)
    assert found is not None
    assert found.exact_margin == pytest.approx(2.506, abs=1e-3)
    assert found.agrees is True
    assert found.certified_inside is True
    certified_ends = [edge.certified_to or 0.0 for edge in found.edges]
    assert certified_ends[0] >= certified_ends[1] >= certified_ends[2]
    assert certified_ends[0] > certified_ends[2]
    assert draw_stability(table, manifest, tmp_path / "m.png").read_bytes()[:4] == PNG
    for over in (["delay", "loss"], ["delay", "per", "loss"]):
        assert draw(table, manifest, tmp_path / "g.png", "gain", over).stat().st_size > 1000


def test_the_trace_of_a_study_run_is_repeated_bit_for_bit(
    native_fmus: Path, tmp_path: Path
) -> None:
    """It carries its own varied scenario, and the system that its design is about."""
    loaded = load_study("delay-margin")
    axis = loaded.study.vary[0].model_copy(update={"linspace": [0.1, 0.3, 2]})
    study = loaded.study.model_copy(update={"vary": [axis], "traces": "worst:1 by growth"})
    run_study(study, tmp_path, scenario=loaded.base, fmus=native_fmus.parent)
    trace = str(tmp_path / "traces" / "run-1.mcap")
    again = cosim(
        "trace", "rerun", trace, "--fmus", str(native_fmus.parent), "--json", cwd=tmp_path
    )
    assert again.code == 0
    assert again.json["identical"] is True


def test_a_measured_boundary_beyond_the_margin_does_not_agree(
    native_fmus: Path, tmp_path: Path
) -> None:
    """The comparison can fail: with a table that says stable beyond the margin it does."""
    path = executed("delay-margin", native_fmus, tmp_path, {"delay": {"linspace": [0.3, 0.4, 3]}})
    table, manifest = read_table(path)
    found = boundary(table, manifest)
    assert found is not None
    assert found.agrees is True
    pretended = {**manifest, "stability": {**manifest["stability"], "exact_margin": 0.45}}
    other = boundary(table, pretended)
    assert other is not None
    assert other.agrees is False
    assert replace(other, exact_margin=found.exact_margin, agrees=True) == found


@pytest.mark.parametrize(("certified", "inside"), [(3.5, True), (4.5, True), (7.5, False)])
def test_certified_is_inside_only_where_every_run_is_stable(
    tmp_path: Path, certified: float, *, inside: bool
) -> None:
    """Runs that end near 1 ... 8, stable below 5, and certified below some number."""
    x = {"path": "final.tiny.x"}
    metrics = {"stable": {**x, "below": 5.0}, "certified": {**x, "below": certified}}
    stability = {"delay": "u", "stable": "stable", "certified": "certified"}
    values = [float(u) for u in range(1, 9)]
    execute_study(plan(values, metrics=metrics, stability=stability), tmp_path / "study")
    table, manifest = read_table(tmp_path / "study")
    assert boundary(table, manifest).certified_inside is None  # type: ignore[union-attr] # of no run that claims
    manifest["study"]["metrics"]["certified"] = {"path": "metrics.guarantee_claimed"}
    found = boundary(table, manifest)
    assert found is not None
    assert found.certified_inside is inside
    assert (found.edges[0].stable_to, found.edges[0].unstable_from) == (5.0, 6.0)  # truth(5) = 4.5
    assert found.edges[0].certified_to == max(u for u in values if truth(u) < certified)
