"""A page of two traces: what each run was, and what differs between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.shell import cosim, shared_run, trace_of
from outcomes.ways import found
from shared import copied
from test_report_text import words

from cosim.trace import Trace, rows_in_force
from cosim.trace.report.comparison import Comparison, comparison_of
from cosim.trace.report.html_page import comparison_page

PAIR = ("auv-acoustic", "auv-acoustic-naive")


@pytest.fixture(scope="module")
def compared() -> Comparison:
    return comparison_of(*map(trace_of, PAIR))


def test_curves_lie_over_each_other_and_their_difference_is_exact(
    compared: Comparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each point is that of the traces, no extreme is lost; the same where it is read in parts."""
    tables = [Trace(trace_of(name)).read("/plant/output") for name in PAIR]
    truth = {one.name: one for one in compared.found.parted}
    monkeypatch.setattr(Trace.borders, "__defaults__", (200_000,))
    in_parts = comparison_of(*map(trace_of, PAIR))
    for (both, apart), (_, again) in zip(compared.apart, in_parts.apart, strict=True):
        assert [curve.label for curve in both.curves] == ["first", "second"]
        if not both.title.startswith("plant."):
            continue
        columns = [table[both.title.removeprefix("plant.")] for table in tables]
        for curve, column in zip(both.curves, columns, strict=True):
            assert np.array_equal(curve.values, column)
        for curve in (apart.curves[0], again.curves[0]):
            at = np.rint(curve.t * 1e9).astype(np.int64)
            rows = [rows_in_force(table.log_time_ns, at) for table in tables]
            a, b = (column[row] for column, row in zip(columns, rows, strict=True))
            assert np.array_equal(curve.values, b - a)
            assert np.abs(curve.values).max() == truth[both.title].max_abs


def test_outcomes_figures_and_links_are_side_by_side(compared: Comparison) -> None:
    """With the ratio of each figure, and what each link did in either run."""
    one, two = (shared_run(name).json for name in PAIR)
    ratios = {row.name: row for row in compared.metrics}
    gains = [run["metrics"]["gain"] for run in (one, two)]
    assert [ratios["gain"].a, ratios["gain"].b] == gains
    assert ratios["gain"].ratio == gains[1] / gains[0]
    assert ratios["saturated_fraction"].ratio is None  # the first was never at a limit
    text = words(comparison_page(compared))
    assert "first: auv-acoustic.mcap ✓ finished 180 s of signals auv-acoustic" in text
    assert "limit cycle 180 s of signals auv-acoustic-naive" in text
    for name in ("uplink", "downlink"):
        for word, run in (("first", one), ("second", two)):
            link = run["links"][name]
            assert f"{name}, {word} {link['sent']} {link['delivered']} {link['dropped']}" in text
    assert "cosim.run seed" not in text  # which is the same


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


def test_runs_without_a_signal_in_common_are_compared() -> None:
    """What only one of them has is listed; outcomes and figures are beside each other."""
    other = comparison_of(trace_of("auv-acoustic"), found("finished").trace)
    text = words(comparison_page(other))
    assert "no signal is in both" in text
    assert "only in the second trace: /pump/output" in text
    assert (other.apart, other.alike) == ([], [])


def test_the_same_run_twice_is_identical() -> None:
    """And its outputs are still shown, once."""
    twice = comparison_of(*[found("finished").trace] * 2)
    assert twice.found.identical
    assert (twice.parted, twice.apart) == ([], [])
    assert [(chart.title, len(chart.curves)) for chart in twice.alike] == [("pump.x", 1)]
    assert "identical" in words(comparison_page(twice))
