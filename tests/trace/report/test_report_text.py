"""What a report says: taken from the trace, in words, with the cause of a failure on top."""

from __future__ import annotations

import builtins
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
import pytest
from cli.shell import cosim, shared_run, trace_of
from outcomes.ways import TITLE, found
from report_files import foreign, small
from report_pages import ReportPage, addresses, report_of, words
from shared import copied

from cosim.core import InputError
from cosim.page import MAX_BYTES
from cosim.trace import RunOutcome, Trace
from cosim.trace.outcome import assumptions_of, outcome_of
from cosim.trace.report import write_report


@pytest.fixture(scope="module")
def naive(tmp_path_factory: pytest.TempPathFactory) -> str:
    return report_of(trace_of("auv-acoustic-naive"), tmp_path_factory.mktemp("naive")).text


def test_the_verdict_is_the_one_of_the_run(naive: str) -> None:
    """Status, gain, bound, norm, and each assumption with its numbers."""
    page_text, metrics = words(naive), shared_run("auv-acoustic-naive").json["metrics"]
    assert "limit cycle" in page_text
    assert "The measured gain is above γ" in page_text
    for key in ("gain", "gamma", "exact_norm"):
        assert f"{metrics[key]:.5g}" in page_text
    age = f"oldest in use {metrics['message_age_s']:.6g} s, designed for any age up to 0.05 s"
    assert f"not met: Measurements were no older than designed for {age}" in page_text
    assert "met: The certificate is valid" in page_text
    assert f"at a limit during {100 * metrics['saturated_fraction']:.3g} % of the time" in page_text
    worst = max(metrics["envelope_use"], key=metrics["envelope_use"].get)
    assert worst == "r"
    assert (
        f"largest use of the bounds: yaw rate {100 * metrics['envelope_use']['r']:.3g} %"
        in page_text
    )


def test_the_first_time_at_a_limit_is_found(naive: str) -> None:
    """The timeline has the time at which the recorded command reaches its limit."""
    command = Trace(trace_of("auv-acoustic-naive")).read("/controller/output")
    for axis in "xyz":
        full = np.flatnonzero(np.abs(command[f"force.{axis}"]) >= 2500.0)
        t = command.log_time_ns[full[0]] / 1e9
        reported = f"{t:.3f}".rstrip("0").rstrip(".")
        assert f"{reported} s controller.force.{axis}: at its limit of 2500 N (" in words(naive)


def test_delivered_and_lost_are_counted(naive: str) -> None:
    """The link table has the counts of the run."""
    page_text = words(naive)
    for name, link in shared_run("auv-acoustic-naive").json["links"].items():
        assert f"{name} {link['sent']} {link['delivered']} {link['dropped']} (" in page_text
        assert f"{link['lost']} lost" in page_text
        assert f"{link['mean_delay_s']:.4g} s {link['max_delay_s']:.4g} s" in page_text


def test_age_of_the_loop_is_the_measured_one(tmp_path: Path) -> None:
    """The curve's greatest value is what the run measured on the way."""
    age = report_of(trace_of("auv-acoustic"), tmp_path).charts["age"]
    loop = age.curves[0]
    assert loop.label.startswith("measurement behind")
    metrics = shared_run("auv-acoustic").json["metrics"]
    assert np.nanmax(loop.values) == pytest.approx(metrics["message_age_s"], abs=1e-6)
    assert age.bounds == [("largest age of a measurement designed for", 1.25)]
    marks = [curve.label for curve in age.curves if curve.drawn["mode"] == "markers"]
    assert marks == ["uplink: not used", "downlink: not used"]


def test_provenance_is_complete(naive: str) -> None:
    """Content hash, FMUs with their hashes, seed, versions, parameters that were set."""
    page_text, trace = words(naive), Trace(trace_of("auv-acoustic-naive"))
    assert shared_run("auv-acoustic-naive").json["content_hash"] in page_text
    for key, value in trace.run.items():
        if key.endswith("sha256") or key in {"seed", "software", "host.numpy", "host.platform"}:
            assert value in page_text, key
    assert "plant initial.eta.x 3 0.0 m scenario" in page_text
    claim = json.loads(trace.run["certificate.claim"])
    assert f"Proved: {claim['property']}, with γ = {claim['gamma']} exactly" in page_text
    assert f"d = {claim['delays'][1]['d']} s: age {claim['delays'][1]['age']}" in page_text
    gain = json.loads(trace.attachments["design.json"])["K"]
    assert f"controller K[1,1] {gain[0][0]:.12g}" in page_text


def test_page_has_no_external_address(naive: str) -> None:
    """Links lead to the page itself; the policy allows its own scripts alone."""
    found = addresses(naive)
    assert found
    assert all(address.startswith(("#", "data:")) for address in found)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', naive)
    assert policy is not None
    rules = policy[1].replace("&#39;", "'")
    assert rules.startswith("default-src 'none'; script-src 'sha256-")
    assert "http" not in rules
    assert "unsafe-eval" not in rules


def test_the_same_trace_gives_the_same_bytes(naive: str, tmp_path: Path) -> None:
    """Also under another path, at another time; and less than three megabytes."""
    copy = tmp_path / "auv-acoustic-naive.mcap"
    copied(trace_of("auv-acoustic-naive"), copy)
    again = report_of(copy, tmp_path).text
    assert again == naive
    assert len(again.encode()) < MAX_BYTES


@pytest.mark.parametrize("kind", ["vehicle", "paper", "far", "foreign"])
def test_plotly_knows_every_property(kind: str, tmp_path: Path) -> None:
    """The charts fit plotly's schema: a misspelt property would be ignored in silence."""
    path = {
        "vehicle": lambda: trace_of("auv-acoustic"),
        "paper": lambda: trace_of("paper-worst-case"),
        "far": lambda: found("far").trace,
        "foreign": lambda: foreign(tmp_path / "f.mcap"),
    }[kind]()
    charts = report_of(path, tmp_path).figures["charts"]
    assert charts
    for figure in charts.values():
        assert figure["data"]
        go.Figure(figure)


def test_cause_of_a_failed_run_is_at_the_top(tmp_path: Path) -> None:
    """Reason, assertions and the log before all else, each said once; markup stays text."""
    page = report_of(found("refused").trace, tmp_path)
    html, page_text = page.text, page.words
    assert TITLE in page_text
    order = [
        "failed, 2 of 3 assertions failed",
        "step from t = 0.4 s returned fmi2Error",
        "the <i>tank</i> stays empty always pump.x < 0.25 failed at 0.3 s",
        "always pump.x >= 0 failed",
        "eventually pump.x > 0.15 passed at 0.2 s",
        "Log, the last 6 of 6 lines",
        "Provenance",
    ]
    places = [page_text.index(part) for part in order[:-1]]
    places.append(page_text.rindex(order[-1]))
    assert places == sorted(places)
    above, _, _ = page_text.partition("Log, the last")
    for words_once in ("has lost its prime", "returned fmi2Error", "<i>tank</i>", "pump.x >= 0"):
        assert above.count(words_once) == 1, words_once
    for empty in ("What went wrong", "Nothing out of the ordinary", "nothing is guaranteed"):
        assert empty not in page_text
    for markup in ("<b>run</b>", "<i>tank</i>", "<pump>"):
        assert markup not in html


@pytest.mark.usefixtures("light")
def test_outages_are_shaded_in_every_chart_over_time(tmp_path: Path) -> None:
    """From where the scenario begins one to where it ends it; and in words, link by link."""
    page = report_of(found("outage").trace, tmp_path)
    assert page.figures["spans"] == [["outage", 2.0, 4.0]]
    words_wanted = "uplink: outage 2 to 4 s; downlink: outage 2 to 4 s"
    assert f"Shaded in all charts over time: {words_wanted}." in page.words
    assert report_of(found("finished").trace, tmp_path).figures["spans"] == []


@pytest.mark.usefixtures("light")
def test_losses_in_a_row_are_shaded(tmp_path: Path) -> None:
    """From the first to after the last of three messages or more that did not arrive."""
    path = trace_of("burst-loss")
    trace, wanted = Trace(path), []
    for link in trace.link_names:
        dropped = trace.read(f"/link/{link}/dropped")
        lost = dropped.log_time_ns[[reason == "lost" for reason in dropped["reason"]]]
        came = trace.read(f"/link/{link}").log_time_ns
        events = sorted([*((t, True) for t in lost), *((t, False) for t in came)])
        since: list[int] = []
        for t, missed in events:
            if missed:
                since.append(t)
                continue
            if len(since) >= 3:
                wanted.append((link, since[0] / 1e9, t / 1e9))
            since = []
        if len(since) >= 3:
            wanted.append((link, since[0] / 1e9, max(t for t, _ in events) / 1e9))
    assert len(wanted) > 3
    figures = report_of(path, tmp_path).figures
    found_spans = [
        (link["name"], begin, end) for link in figures["links"] for _, begin, end in link["spans"]
    ]
    last = figures["span"][1]
    assert [s for s in found_spans if s[2] != last] == [s for s in wanted if s[2] < last][
        : len([s for s in found_spans if s[2] != last])
    ]
    assert len(found_spans) == len(wanted)


@pytest.mark.usefixtures("light")
def test_every_axis_has_a_name_and_its_unit(tmp_path: Path) -> None:
    """Time in seconds, and each quantity in the unit of its signals."""
    page = report_of(trace_of("auv-acoustic"), tmp_path)
    for key, chart in page.charts.items():
        layout = page.figures["charts"][key]["layout"]
        assert layout["xaxis"]["title"]["text"] == "time t [s]"
        assert layout["yaxis"]["title"]["text"].endswith(f" [{chart.unit}]" if chart.unit else "")
        assert len(layout["yaxis"]["title"]["text"]) > len(chart.unit) + 3
    assert (
        page.figures["charts"]["plant-eta.x"]["layout"]["yaxis"]["title"]["text"] == "North x [m]"
    )


@pytest.mark.usefixtures("light")
@pytest.mark.parametrize("name", ["outage", "refused"])
def test_the_first_line_is_that_of_the_run(name: str, tmp_path: Path) -> None:
    """How it ended, why, and what it may claim: the line that `cosim run` prints first."""
    line = " ".join(found(name).summary.partition("next:")[0].split())
    page_text = report_of(found(name).trace, tmp_path).words
    assert line in page_text.replace(" ;", ";").replace(" :", ":").replace("\u2022 ", "").replace(
        "\u2717 ", ""
    )


@pytest.mark.usefixtures("light")
def test_a_trace_without_events_does_not_say_that_nothing_happened(tmp_path: Path) -> None:
    """One of an older version lists none, though commands stood at their limits."""
    old = Path(__file__).parents[3] / "traces" / "reference" / "auv-acoustic-naive.mcap"
    page_text = report_of(old, tmp_path).words
    assert "The trace lists no events." in page_text
    assert "Nothing out of the ordinary" not in page_text
    assert "Nothing out of the ordinary" in report_of(found("finished").trace, tmp_path).words


@pytest.mark.usefixtures("light")
def test_infinite_values_are_reported(tmp_path: Path) -> None:
    """The first one, and where values are drawn that are too large."""
    page_text = report_of(found("diverged").trace, tmp_path).words
    assert "What went wrong 0.6 s pump.x is 1e+20" in page_text
    assert page_text.partition("Log, ")[0].count("pump.x grew step by step and is inf") == 1
    far = report_of(found("far").trace, tmp_path).words
    assert "values beyond 1e+150: drawn there: plant.eta.z, plant.eta.psi" in far


PROMISES = """
extends = "auv-direct"
title = "A guarantee is kept, and three of five promises"
[run]
end = 5.0
[[assertions]]
always = "abs(plant.eta.x) < 100"
[[assertions]]
always = "t < 0"
expected = "fails"
[[assertions]]
name = "soon"
always = "t < 1 s"
[[assertions]]
eventually = "t > 1.5 s"
[[assertions]]
always = "t >= 0"
expected = "fails"
"""
REPORTED = [
    ("bad", "soon", "failed", 1.0),
    ("bad", "always t >= 0", "failed: it holds, but was expected to fail", None),
    ("good", "always abs(plant.eta.x) < 100", "passed", None),
    ("good", "always t < 0", "passed: it fails, as expected", 0.0),
]
"""Those that failed first, else as in the scenario."""


def test_a_failed_assertion_is_reported_first(native_fmus: Path, tmp_path: Path) -> None:
    """By the run, its report, and `trace info`: failed, kept as passed, none as open.

    The bound on the gain is another matter, and is claimed beside them.
    """
    (tmp_path / "s.toml").write_text(PROMISES)
    more = ("--flavour", "native", "--fmus", native_fmus.parent, "--out", "t.mcap")
    traces = cosim("run", "s.toml", *more, cwd=tmp_path)
    assert traces.code == 1
    report = write_report(tmp_path / "t.mcap")
    page = ReportPage(report.output)
    assert (page.tone, page.status) == ("bad", "finished, 2 of 5 assertions failed")
    assert report.status == page.status
    reported = [(c.tone, c.what, c.why, c.at) for c in report.assertions]
    assert reported[:4] == REPORTED
    assert reported[4] == ("good", "eventually t > 1.5 s", "passed", 1.55)
    assert report.guarantee is not None
    assert report.guarantee.tone == "good"
    failed = page.words.index("soon always t < 1 s failed at 1 s")
    assert failed < page.words.index("The guarantee holds")
    info = cosim("trace", "info", "t.mcap", cwd=tmp_path).out
    places = [info.index(f"assertion {what}") for _, what, _, _ in reported]
    assert places == sorted(places)
    lines = {line.strip() for line in re.sub(" {2,}", "  ", info).splitlines()}
    assert "state  finished, 2 of 5 assertions failed" in lines
    for _, what, why, at in reported:
        line = f"assertion {what}  {why}" + ("" if at is None else f" at {at:g} s")
        assert line in lines
        assert re.search(rf"{re.escape(line.partition('  ')[2])} +{re.escape(what)}", traces.out)


def test_assertions_of_a_trace_for_programs_are_those_of_the_run(tmp_path: Path) -> None:
    """`run --json`, the trace and `trace info --json` say the same, key by key.

    A run that was stopped leaves open what it did not get to.
    """
    folder = copied(found("refused").trace.parent, tmp_path / "run")
    for more, results in (
        ((), ["holds", "fails", "fails"]),
        (("--until", "0.2"), ["holds", "undecided", "undecided"]),
    ):
        traces = cosim("run", "refused.toml", "--json", "--out", "t.mcap", *more, cwd=folder)
        reported = cosim("trace", "info", "t.mcap", "--json", cwd=folder)
        assert reported.json["result"]["assertions"] == traces.json["assertions"]
        assert [v["result"] for v in traces.json["assertions"]] == results
    report = write_report(folder / "t.mcap")
    assert report.status == "stopped"
    assert [c.tone for c in report.assertions] == ["good", "open", "open"]
    assert report.assertions[1].why == "undecided: the run ended before"


def test_a_recording_of_another_tool_has_a_report(tmp_path: Path) -> None:
    """Its numbers by topic, its times from the first message on, and what could not be read."""
    page = report_of(foreign(tmp_path / "foreign.mcap"), tmp_path)
    chart = next(iter(page.charts.values()))
    assert chart.title == "/lab/sensors/1"
    assert [c.label for c in chart.curves] == ["temperature", "count"]
    assert not chart.curves[0].stepwise
    assert chart.curves[0].t[[0, -1]] == pytest.approx([0.0, 49.9])
    assert page.status == "recording"
    assert "/lab/sensors/1 constant 500 4 4 4 4" in page.words
    assert "1700000000000000000 ns" in page.words
    assert "/camera" in page.words


def test_unfinished_run_is_reported_as_cut_short(tmp_path: Path) -> None:
    """A .partial file: the recorded part is drawn, and its end is reported."""
    data = trace_of("auv-acoustic").read_bytes()
    cut = tmp_path / "run.mcap.partial"
    cut.write_bytes(data[: len(data) // 2])
    written = write_report(cut)
    assert written.output == tmp_path / "run.partial.html"
    assert written.status == "cut short"
    assert written.charts > 10
    assert "The file ends early" in words(written.output.read_text("utf-8"))


@pytest.mark.parametrize(
    ("assumption", "metrics", "words_wanted"),
    [
        ("message_age_within_design", {"message_age_s": None, "designed_age_s": 1.0}, "no meas"),
        ("message_age_within_design", {"message_age_s": 0.5, "designed_age_s": 1.0}, "substitute"),
        ("message_age_within_design", {"message_age_s": 0.5, "designed_age_s": 0.0}, "without del"),
        ("limits_not_reached", {"saturated_fraction": 0.0}, "from the zero state"),
        ("state_inside_envelope", {"envelope_use": {"u": 1e300}}, "surge beyond all numbers"),
        ("plant_as_designed", {}, "other parameters"),
        ("something_new", {}, "not met"),
    ],
)
def test_why_an_assumption_is_not_met(
    assumption: str, metrics: dict[str, Any], words_wanted: str
) -> None:
    """Each reason has its text."""
    outcome = RunOutcome(metrics={**metrics, "assumptions": {assumption: False}})
    (check,) = assumptions_of(outcome)
    assert check.tone == "bad"
    assert words_wanted in check.why


def test_figures_of_any_type_are_accepted() -> None:
    """Values of other types in place of figures are ignored."""
    for result in ({}, {"metrics": '"text"'}, {"metrics": '{"assumptions": [1]}'}):
        outcome = outcome_of(result)
        assert outcome is not None
        assert assumptions_of(outcome) == []
        assert isinstance(outcome.metrics, dict)


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without their library, which takes longest and is always the same."""
    monkeypatch.setattr("cosim.page.render.plotly_js", lambda: "")


@pytest.mark.slow
@pytest.mark.usefixtures("light")
def test_damaged_trace_gives_a_report_or_an_error(tmp_path: Path) -> None:
    """Cut anywhere, a byte changed anywhere: what can be read is shown."""
    whole = small(tmp_path / "small.mcap").read_bytes()
    path, displayed = tmp_path / "damaged.mcap", 0
    changes = [bytes([*whole[:k], whole[k] ^ 0x55, *whole[k + 1 :]]) for k in range(0, 6000, 301)]
    for data in [*(whole[:k] for k in range(0, len(whole), len(whole) // 25)), *changes]:
        path.write_bytes(data)
        try:
            html = report_of(path, tmp_path).text
        except InputError:
            continue
        displayed += 1
        assert "</html>" in html
    assert displayed > 20


@pytest.mark.usefixtures("light")
@pytest.mark.parametrize("value", ["x", 1, [1], {"a": [{}]}, None, True, 1e308, ""])
def test_result_of_any_content_gives_a_page(value: Any, tmp_path: Path) -> None:
    """Whatever stands where figures, assertions, links or a claim should: a page comes out."""
    keys = ("gain", "gamma", "assumptions", "assertions", "envelope_use", "worst_case")
    text = json.dumps(value)
    metrics = json.dumps(dict.fromkeys((*keys, "message_age_s", "designed_age_s"), value))
    path = small(
        tmp_path / "odd.mcap",
        run={
            "step_ns": text,
            "seed": text,
            "certificate.sha256": text,
            "certificate.claim": json.dumps({"gamma": value, "delays": value}),
        },
        result={"status": text, "metrics": metrics, "assertions": text, "link.up.sent": text},
        scenario=json.dumps({"components": value}).encode(),
    )
    assert "</html>" in report_of(path, tmp_path).text


@pytest.mark.usefixtures("light")
@pytest.mark.parametrize(
    ("name", "report"),
    [
        ("a/run.mcap", "a/run.html"),
        ("run.mcap.partial", "run.partial.html"),
        ("run", "run.html"),
        (".mcap", ".mcap.html"),
    ],
)
def test_default_place_of_a_report(tmp_path: Path, name: str, report: str) -> None:
    """The report is beside the trace and never replaces it."""
    trace = tmp_path / name
    trace.parent.mkdir(exist_ok=True)
    small(tmp_path / "small.mcap").rename(trace)
    whole = trace.read_bytes()
    assert write_report(trace).output == tmp_path / report
    assert (tmp_path / report).read_text("utf-8").startswith("<!doctype html>")
    assert trace.read_bytes() == whole


def test_without_plotly_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The message says what to install; nothing is written."""
    path, real = copied(found("far").trace, tmp_path / "far.mcap"), builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.startswith("plotly"):
            raise ImportError("No module named 'plotly'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"auv-cosim\[report\]"):
        write_report(path)
    assert not (tmp_path / "far.html").exists()


def test_report_command(tmp_path: Path) -> None:
    """`cosim trace report`: JSON, words, its own place, and refusals."""
    copied(found("refused").trace, tmp_path / "failing.mcap")
    reported = cosim("trace", "report", "failing.mcap", "--json", cwd=tmp_path)
    assert reported.code == 0, reported.err
    assert reported.json["output"] == "failing.html"
    assert reported.json["status"] == "failed, 2 of 3 assertions failed"
    assert reported.json["guarantee"] is None
    assert reported.json["assertions"][0]["tone"] == "bad"
    assert (tmp_path / "failing.html").stat().st_size == reported.json["bytes"] < 3_000_000
    seen = cosim("trace", "report", "failing.mcap", "-o", "sub/x.html", cwd=tmp_path)
    assert seen.code == 0
    assert "sub/x.html" in seen.out
    assert (tmp_path / "sub" / "x.html").exists()
    for arguments in (
        ("none.mcap",),
        ("failing.html",),
        ("failing.mcap", "-o", "failing.mcap"),
        (".",),
    ):
        refused = cosim("trace", "report", *arguments, "--json", cwd=tmp_path)
        assert refused.code == 2
        assert refused.error["what"]
    assert Trace(tmp_path / "failing.mcap").finished
