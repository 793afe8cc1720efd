"""The page about a study: what it says agrees with the table, whatever became of the runs."""

from __future__ import annotations

import builtins
import json
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from cli.shell import cosim
from report_browser import Page, browser, needs_chromium
from shared import copied, sampled
from study.deadly import study
from study.pages import figures_of, numbers, page_of, words
from study.run_logs import table_of
from study.studies_at_hand import STUDIES, drawn, grid, study_folder

from cosim.core import InputError
from cosim.study import read_table, summarise, write_study_report


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without their library, which takes longest and is always the same."""
    monkeypatch.setattr("cosim.page.render.plotly_js", lambda: "")


def unfinished(folder: Path, target: Path, *, lines: int) -> Path:
    """Return a copy of a study as it was when so many runs were done."""
    copied(folder, target)
    for name in ("results.parquet", "journal.jsonl", "study.json"):
        (target / name).chmod(0o600)
    (target / "results.parquet").unlink()
    log = target / "journal.jsonl"
    log.write_text("".join(log.read_text("utf-8").splitlines(keepends=True)[:lines]), "utf-8")
    return target


@pytest.mark.usefixtures("light")
def test_page_agrees_with_the_table(tmp_path: Path) -> None:
    """Statuses, causes, commands, statistics, missing values; markup of the study stays text."""
    folder = study_folder("mixed")
    table, manifest = read_table(folder)
    rows = table.to_pylist()
    html = page_of(folder, tmp_path / "mixed.html")
    text = words(html)
    counts = Counter(row["status"] for row in rows)
    assert set(counts) == {"finished", "crashed", "assertion_failed"}
    for status, count in counts.items():
        share = f"{count} {100 * count / 48:.1f} %"
        assert f"{status.replace('_', ' ')} {share}" in text
    assert f"{counts['crashed']} of 48 runs have no result" in text
    first = next(row["run"] for row in rows if row["status"] == "crashed")
    assert f"cosim study repeat {folder} {first}" in text
    assert "SIGKILL" in text
    assert "failed: x <i>stays</i> below 400" in text
    assert "x follows <b>u</b>, and dies" in text
    assert "<i>stays" not in html
    assert "follows <b>u" not in html
    values = [row["x"] for row in rows if row["status"] != "crashed"]
    assert {row["x"] for row in rows if row["status"] == "crashed"} == {None}
    found = summarise(table, manifest, [], quantiles=(0.95,)).groups[0].numbers["x"]
    assert found.count == len(values)
    # over a grid, whose values were chosen, no interval
    assert f"x {len(values)} (12 without) {found.mean:.5g} {found.deviation:.4g}" in text
    assert f"{found.quantiles[0].value:.4g} {found.maximum:.4g}" in text
    small = sum(row["small"] for row in rows)
    assert f"small {small} 48 {100 * small / 48:.2f} %" in text
    missing = sum(row["settled"] is None for row in rows)
    assert 0 < missing < 48
    assert f"settling_time of tiny.x within 200 · {missing} of 48 runs have no value" in text
    assert "uniform from -700 to 700; independent draws" in text


@pytest.mark.usefixtures("light")
def test_worst_runs_are_ranked_and_lead_to_their_traces(tmp_path: Path) -> None:
    """All runs by the metric of `traces`; a link only where there is a trace, from the page on."""
    folder = study_folder("mixed")
    rows = read_table(folder)[0].to_pylist()
    (tmp_path / "deep").mkdir()
    html = page_of(folder, tmp_path / "deep" / "page.html")
    for chosen in ("x", "largest"):
        assert re.search(f"<option[^>]* selected[^>]*>{chosen}<", html)
    worst = figures_of(html)["worst"]
    whole = [row for row in rows if row["x"] is not None]
    ranked = sorted(whole, key=lambda row: (-row["x"], row["run"]))
    listed = worst["order"]["x"]["largest"]
    assert listed == [row["run"] for row in ranked]
    links = {run: worst["runs"][str(run)]["trace"] for run in listed}
    kept = {run: link for run, link in links.items() if link is not None}
    assert len(kept) == 2
    for run, link in kept.items():
        assert (tmp_path / "deep" / link).resolve() == (folder / "traces" / f"run-{run:02}.mcap")
        assert run in [row["run"] for row in ranked][:2]


@pytest.mark.usefixtures("light")
@pytest.mark.parametrize("name", sampled(STUDIES, 2))
def test_plotly_knows_every_property(name: str, tmp_path: Path) -> None:
    """The charts fit plotly's schema: a misspelt property would be ignored in silence."""
    figures = figures_of(page_of(study_folder(name), tmp_path / "page.html"))
    assert figures["charts"]
    json.dumps(figures, allow_nan=False)
    for chart in figures["charts"].values():
        layout = json.loads(json.dumps(chart["layout"]))
        for axis in ("xaxis", "yaxis"):
            layout[axis]["title"] = {"text": layout[axis].pop("title")}
        data = []
        for trace in chart["data"]:
            assert set(trace["meta"]) <= {"role", "points", "scale"}
            data.append(trace)
        go.Figure({"data": data, "layout": layout})


@pytest.mark.usefixtures("light")
def test_same_study_same_page(tmp_path: Path) -> None:
    """Byte for byte; and another confidence is another page."""
    folder = study_folder("mixed")
    first = write_study_report(folder, tmp_path / "one.html")
    again = write_study_report(folder / "results.parquet", tmp_path / "two.html")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()
    assert first.bytes == again.bytes == (tmp_path / "one.html").stat().st_size
    write_study_report(folder, tmp_path / "two.html", confidence=0.9)
    assert (tmp_path / "one.html").read_bytes() != (tmp_path / "two.html").read_bytes()


@pytest.mark.slow
@pytest.mark.usefixtures("light")
def test_studies_of_one_run_of_failures_and_of_rare_events(tmp_path: Path) -> None:
    """Each has a page that says what it is."""
    pages = {
        name: words(page_of(study_folder(name), tmp_path / "page.html"))
        for name in ("one", "dead", "rare", "indices")
    }
    assert "1 run, with a result" in pages["one"]
    assert "3 of 3 runs have no result" in pages["dead"]
    assert "x 0 (3 without)" in pages["dead"]
    assert "No run has a value." in pages["dead"]
    assert "P(x > 1)" in pages["rare"]
    assert "100 runs of the first level" in pages["rare"]
    assert "Sensitivity of x" in pages["indices"]


@pytest.mark.slow
@pytest.mark.usefixtures("light")
def test_an_unfinished_study_and_a_damaged_run_log(tmp_path: Path) -> None:
    """The runs that are done; lines that cannot be read are counted, exit code 3; none: 2."""
    folder = unfinished(study_folder("mixed"), tmp_path / "part", lines=20)
    found = cosim("study", "report", "part", "--json", cwd=tmp_path)
    assert found.code == 0
    assert (found.json["runs"], found.json["count"], found.json["complete"]) == (20, 48, False)
    assert sum(found.json["statuses"].values()) == 20
    page = (folder / "report.html").read_text("utf-8")
    assert "not finished: 20 of 48 runs" in words(page)
    log = folder / "journal.jsonl"
    rows = log.read_text("utf-8").splitlines()
    others = ["{", '[99, "finished", null, 0.1, 1.0, true, "finished", 1.0]', '[1, "finished"]']
    log.write_text("\n".join([*rows, *others, '[7, "fin']), "utf-8")
    found = cosim("study", "report", "part", "--json", cwd=tmp_path)
    assert (found.code, found.json["runs"], found.json["unread"]) == (3, 20, 3)
    assert "3 lines of the run log cannot be read" in words(
        (folder / "report.html").read_text("utf-8")
    )
    log.write_text("\n".join([*others, ""]), "utf-8")
    found = cosim("study", "report", "part", "--json", cwd=tmp_path)
    assert found.code == 2
    assert "the run log is damaged" in found.error["what"]
    log.write_text("")
    found = cosim("study", "report", "part", "--json", cwd=tmp_path)
    assert (found.code, found.json["runs"]) == (0, 0)


@pytest.mark.usefixtures("light")
def test_later_levels_of_an_unfinished_rare_event_are_read(tmp_path: Path) -> None:
    """They have numbers beyond the count of runs that was known when the study began."""
    folder = unfinished(study_folder("rare"), tmp_path / "rare", lines=99)
    manifest = json.loads((folder / "study.json").read_text("utf-8"))
    (folder / "study.json").write_text(json.dumps(manifest | {"count": 90}), "utf-8")
    found = write_study_report(folder)
    assert (found.runs, found.unread, found.complete) == (99, 0, False)


def test_what_is_no_study_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Exit code 2 and the cause; nothing is written."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "study.json").write_text('{"digest": "", "study": {"a": 1}, "count": 1}')
    copied(study_folder("one"), tmp_path / "one")
    for arguments, cause in (
        (("nowhere",), "not the results of a study"),
        (("empty",), "not the folder of a study"),
        (("odd",), "not the manifest of a study"),
        (("one", "--confidence", "2"), "not a confidence"),
        (("one", "-o", "one/results.parquet"), "would replace its study"),
        (("one", "-o", "one/study.json/x.html"), "cannot be written"),
    ):
        refused = cosim("study", "report", *arguments, "--json", cwd=tmp_path)
        assert refused.code == 2
        assert cause in refused.error["what"]
    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("plotly"):
            raise ImportError("No module named 'plotly'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"auv-cosim\[report\]"):
        write_study_report(tmp_path / "one", tmp_path / "x.html")
    assert not (tmp_path / "x.html").exists()


@pytest.mark.usefixtures("light")
def test_many_runs_are_thinned_by_their_numbers_alone(tmp_path: Path) -> None:
    """The extremes are kept, no stride of the grid is, and a part of the runs gives a part."""
    axes = [grid("x0", [0.0, 1.0, 2.0]), drawn("u", uniform=[0.0, 1.0])]
    values = np.random.default_rng(1).normal(size=(2, 1800)).tolist()
    made = study([], vary=axes, samples=600, metrics={"x": "final.tiny.x", "y": "final.tiny.x"})
    rows = [[k, "finished", None, 0.0, x, y] for k, (x, y) in enumerate(zip(*values, strict=True))]
    found = []
    for count in (1800, 1700):
        folder = tmp_path / str(count)
        table, _ = table_of(made, rows[:count], folder)
        html = page_of(folder, folder / "page.html")
        found.append(figures_of(html))
        kept = found[-1]["runs"]
        assert 1500 <= len(kept) <= 1500 + 2 * 2
        for metric in "xy":
            column = table[metric].to_numpy()
            assert {int(column.argmax()), int(column.argmin())} <= set(kept)
        assert f"Of {count:,} runs, at most {len(kept):,} are drawn as points" in words(html)
        assert np.ptp(np.diff(kept)) > 0
        assert len(set(numbers(found[-1]["columns"]["x0"]["values"]))) == 3
        assert len(set(numbers(found[-1]["columns"]["u"]["values"]))) > 300
    whole, part = (set(one["runs"]) for one in found)
    assert len({run for run in whole if run < 1700} - part) <= 2 * 2  # extremes of one alone


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One browser for all tests of this file."""
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


UNDRAWN = """[...document.querySelectorAll('.plot')].filter(
    (div) => !div.closest('details:not([open])') && !div.querySelector('.main-svg')
).map((div) => div.id)"""
PICK = """((id, value) => { const made = document.getElementById(id); made.value = value;
    made.dispatchEvent(new Event('change')); })"""


@pytest.mark.slow
@needs_chromium
def test_page_in_a_browser(page: Page, tmp_path: Path) -> None:
    """Drawn in light and dark, wide and narrow; the worst runs and any two columns are chosen."""
    target = tmp_path / "mixed.html"
    write_study_report(study_folder("mixed"), target)
    ground = "getComputedStyle(document.body).backgroundColor"
    grounds = []
    for width, scheme in ((1400, "light"), (390, "dark")):
        page.errors.clear()
        page.asked.clear()
        page.open(target, width=width, scheme=scheme)
        assert page.ask("document.documentElement.scrollWidth") <= width
        assert page.ask(UNDRAWN) == []
        page.ask("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        page.ask("new Promise((done) => setTimeout(done, 3000))")
        assert page.ask(UNDRAWN) == []
        assert page.ask("document.querySelectorAll('.plot .main-svg').length") > 10
        grounds.append(page.ask(ground))
    assert grounds[0] != grounds[1]
    cells = (
        "[...document.querySelectorAll('#worst-runs tbody tr')].map((r) => r.cells[1].innerText)"
    )
    page.ask(f"{PICK}('worst-order', 'smallest'); {PICK}('worst-count', '5')")
    rows = read_table(study_folder("mixed"))[0].to_pylist()
    least = sorted(row["x"] for row in rows if row["x"] is not None)[:5]
    assert page.ask(cells) == [f"{value:.5g}" for value in least]
    page.ask(f"{PICK}('explore-x', 'decay'); {PICK}('explore-y', 'outcome')")
    points = "document.getElementById('chart-explore').data.map((d) => d.x.length)"
    finished, flagged, gone, missing = page.ask(points)
    statuses = Counter(row["status"] for row in rows)
    assert finished == statuses["finished"]
    assert flagged == statuses["assertion_failed"]
    assert gone + missing == statuses["crashed"]
    page.ask("document.getElementById('theme').click()")
    page.ask("window.dispatchEvent(new Event('beforeprint'))")
    assert page.ask(ground) == grounds[0]
    assert page.errors == []
    assert page.asked == []
    assert page.ask("""[...document.querySelectorAll('a[href^="#"]')].every(
        (link) => document.getElementById(link.hash.slice(1)))""")
