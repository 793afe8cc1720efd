"""A page of two traces: what each run was, and what differs between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim, shared_run, trace_of
from numpy.typing import NDArray
from outcomes.ways import found
from report_pages import Chart, Curve, ReportPage, words
from shared import copied

from cosim.page import packed_values
from cosim.trace import Trace, diff
from cosim.trace.report import write_comparison
from cosim.trace.rows import rows_in_force

PAIR = ("auv-acoustic", "auv-acoustic-naive")


def compared(first: Path, second: Path, folder: Path) -> ReportPage:
    """The page of two traces."""
    return ReportPage(write_comparison(first, second, folder / "compared.html").output)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> ReportPage:
    return compared(*map(trace_of, PAIR), tmp_path_factory.mktemp("compared"))


def charts(page: ReportPage, kind: str) -> list[Chart]:
    """Those of a kind, in their order."""
    return [chart for key, chart in page.charts.items() if key.startswith(f"{kind}-")]


def drawn_of(instants_ns: NDArray[np.int64], curve: Curve) -> NDArray[np.intp]:
    """Which of the instants are those of a curve, which are drawn with few digits."""
    at = instants_ns / 1e9
    nearest: NDArray[np.intp] = np.abs(at[:, None] - curve.t).argmin(axis=0)
    assert np.abs(at[nearest] - curve.t).max() < 1e-3
    return nearest


def test_curves_lie_over_each_other_and_their_difference_is_exact(
    page: ReportPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each point is that of the traces, no extreme is lost; the same where it is read in parts."""
    tables = [Trace(trace_of(name)).read("/plant/output") for name in PAIR]
    truth = {one.name: one for one in diff(*map(trace_of, PAIR)).parted}
    monkeypatch.setattr(Trace.borders, "__defaults__", (200_000,))
    in_parts = compared(*map(trace_of, PAIR), tmp_path)
    seen = 0
    instants = np.union1d(*(table.log_time_ns for table in tables))
    for both, apart, same, again in zip(
        *(charts(one, kind) for one in (page, in_parts) for kind in ("both", "apart")), strict=True
    ):
        assert [curve.drawn for curve in both.curves] == [curve.drawn for curve in same.curves]
        assert [curve.label for curve in both.curves] == ["first", "second"]
        assert apart.title == again.title == f"{both.title}, second minus first"
        if not both.title.startswith("plant."):
            continue
        seen += 1
        columns = [table[both.title.removeprefix("plant.")] for table in tables]
        for curve, table, column in zip(both.curves, tables, columns, strict=True):
            rows = drawn_of(table.log_time_ns, curve)
            assert curve.packed[1] == packed_values(column[rows])
            assert {column.argmin(), column.argmax()} <= {*rows.tolist()}
        for curve in (apart.curves[0], again.curves[0]):
            at = instants[drawn_of(instants, curve)]
            in_force = [rows_in_force(table.log_time_ns, at) for table in tables]
            a, b = (column[row] for column, row in zip(columns, in_force, strict=True))
            assert curve.packed[1] == packed_values(b - a)
            assert np.abs(b - a).max() == truth[both.title].max_abs
    assert seen > 5


def test_outcomes_figures_and_links_are_side_by_side(page: ReportPage) -> None:
    """With the ratio of each figure, and what each link did in either run."""
    one, two = (shared_run(name).json for name in PAIR)
    gains = [run["metrics"]["gain"] for run in (one, two)]
    assert f"gain {gains[0]:.5g} {gains[1]:.5g} {gains[1] / gains[0]:.4g}" in page.words
    saturated = [run["metrics"]["saturated_fraction"] for run in (one, two)]
    assert saturated[0] == 0.0  # the first was never at a limit: there is no ratio
    assert f"saturated_fraction 0 {saturated[1]:.5g} –" in page.words
    assert "first: auv-acoustic.mcap ✓ finished 180 s of signals auv-acoustic" in page.words
    assert "limit cycle 180 s of signals auv-acoustic-naive" in page.words
    for name in ("uplink", "downlink"):
        for word, run in (("first", one), ("second", two)):
            link = run["links"][name]
            row = f"{name}, {word} {link['sent']} {link['delivered']} {link['dropped']}"
            assert row in page.words
    assert "cosim.run seed" not in page.words  # which is the same


def test_failed_runs_are_compared(tmp_path: Path) -> None:
    """By the command: how each ended, which assertion failed in which, what was set differently."""
    for name in ("refused", "assertion"):
        copied(found(name).trace, tmp_path / f"{name}.mcap")
    verb = ("trace", "report", "refused.mcap", "--compare", "assertion.mcap")
    written = cosim(*verb, "--json", cwd=tmp_path)
    assert written.code == 0, written.err
    assert written.json["output"] == "refused-assertion.html"
    assert written.json["statuses"] == [found(name).badge for name in ("refused", "assertion")]
    assert (written.json["equal"], written.json["differing"]) == (False, 0)
    html = (tmp_path / "refused-assertion.html").read_text("utf-8")
    assert len(html.encode()) == written.json["bytes"] < 3_000_000
    text = words(html)
    for line in (
        "got: the <pump> has lost its prime",
        "the <i>tank</i> stays empty ✗ failed at 0.3 s ✗ failed at 0.3 s",
        "always pump.x >= 0 ✗ failed ✓ passed",
        "end: t = 0.4 s and 1 s",
        "-parameters = { u = 1.0, fault = 23",
        "+parameters = { u = 1.0, fault = 0",
    ):
        assert text.count(line) == 1, line
    refused = cosim(*verb, "-o", "assertion.mcap", "--json", cwd=tmp_path)
    assert refused.code == 2
    assert "would replace its trace" in refused.error["what"]


def test_runs_without_a_signal_in_common_are_compared(tmp_path: Path) -> None:
    """What only one of them has is listed; outcomes and figures are beside each other."""
    other = compared(trace_of("auv-acoustic"), found("finished").trace, tmp_path)
    assert "no signal is in both" in other.words
    assert "only in the second trace: /pump/output" in other.words
    assert not [key for key in other.charts if not key.startswith("age")]


def test_the_same_run_twice_is_identical(tmp_path: Path) -> None:
    """And its outputs are still shown, once."""
    trace = found("finished").trace
    written = write_comparison(trace, trace, tmp_path / "twice.html")
    assert (written.equal, written.differing, written.verdict) == (True, 0, "identical")
    twice = ReportPage(written.output)
    assert twice.status == "identical"
    assert [(chart.title, len(chart.curves)) for chart in twice.charts.values()] == [("pump.x", 1)]
    assert [*twice.charts] == ["alike-0"]
