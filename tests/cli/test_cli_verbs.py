"""What every verb prints when all is well."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from cli.shell import BUILT_IN, cosim, shared_run, trace_of
from shared import fmu_store

from cosim.hinf import check_certificate


def test_scenarios_are_listed(tmp_path: Path) -> None:
    """Names and titles, for programs and for people."""
    rows = cosim("scenario", "list", "--json", cwd=tmp_path).json["scenarios"]
    names = [row["name"] for row in rows]
    assert names == sorted(names)
    assert set(names) >= set(BUILT_IN)
    assert all(row["title"] for row in rows)
    seen = cosim("scenario", "list", cwd=tmp_path)
    assert seen.code == 0
    assert all(row["title"] in seen.out for row in rows)


def test_the_former_name_of_scenario_list_is_hidden_and_works(tmp_path: Path) -> None:
    """`cosim scenarios` gives what `cosim scenario list` gives; help names the latter alone."""
    for options in ([], ["--json"]):
        now = cosim("scenario", "list", *options, cwd=tmp_path)
        assert cosim("scenarios", *options, cwd=tmp_path).out == now.out
    displayed = cosim("--help", cwd=tmp_path).out
    assert re.search(r"^  scenario  +List", displayed, re.MULTILINE)
    assert not re.search(r"\bscenarios\b", displayed.replace("show scenarios", ""))


def test_design_of_the_paper(tmp_path: Path) -> None:
    """At k1 = 0.6, k2 = 0.2 the corrected LMI gives 5.0132, certified; the norm is below."""
    result = cosim(
        "design",
        "paper",
        "--k1",
        "0.6",
        "--k2",
        "0.2",
        "--order",
        "theorem-2",
        "--json",
        "--save",
        "d.json",
        cwd=tmp_path,
    )
    assert result.code == 0
    found = result.json
    assert found["gamma"] == pytest.approx(5.0132, abs=5e-4)
    assert found["certified"] is True
    assert [len(row) for row in found["K"]] == [2]
    assert 5.0 <= found["exact_norm"] <= found["gamma"]
    assert found["abscissa"] < 0.0
    saved = json.loads((tmp_path / "d.json").read_text())
    assert saved["K"] == found["K"]
    assert check_certificate(saved).valid


@pytest.mark.slow
def test_design_with_bessel_legendre_order(tmp_path: Path) -> None:
    """`--order`: below Theorem 2's gamma, no k1, k2 in the proof, and a file that is checked."""
    arguments = ("design", "paper", "--k1", "0.6", "--k2", "0.2", "--order", "1")
    found = cosim(*arguments, "--json", "--save", "d.json", cwd=tmp_path).json
    assert 5.0 < found["gamma"] < 5.0132
    assert found["exact_norm"] <= found["gamma"]
    assert (found["k1"], found["k2"], found["order"]) == (None, None, 1)
    assert found["up_to_delays"] in {True, False}
    checked = cosim("certificate", "check", "d.json", "--json", cwd=tmp_path)
    assert checked.code == 0
    assert "order 1" in cosim(*arguments, cwd=tmp_path).out
    far = cosim(*arguments, "--gamma", "6", "--max-delay", "--json", cwd=tmp_path).json
    assert far["delays"] == [20.0]
    assert far["limit_reached"] is True


def test_design_of_a_scenario_is_the_one_it_runs_with(tmp_path: Path) -> None:
    """The name of a scenario designs what its [design] says: the printed gain, analysed.

    The proof may be better than the one kept with the scenario, never worse.
    """
    found = cosim("design", "paper-example", "--json", cwd=tmp_path).json
    assert found["K"] == [[0.6432, -0.5679]]
    assert found["exact_norm"] < found["gamma"]
    assert found["gamma"] <= shared_run("paper-example").json["metrics"]["gamma"]


@pytest.mark.parametrize("name", BUILT_IN)
def test_info_agrees_with_the_output_of_run(name: str, tmp_path: Path) -> None:
    """Status, metrics, links and hash in the trace are those that were printed."""
    ran = shared_run(name).json
    reported = cosim("trace", "info", trace_of(name), "--json", cwd=tmp_path).json
    assert reported["finished"] is True
    assert reported["complete"] is True
    assert reported["content_hash"] == ran["content_hash"]
    assert reported["result"]["status"] == ran["status"]
    assert reported["result"]["metrics"] == ran["metrics"]
    assert reported["result"]["final"] == ran["final"]
    assert set(reported["links"]) == set(ran["links"])


def test_text_output_shows_the_same_figures(tmp_path: Path) -> None:
    """Without --json: status, links and assumptions in words."""
    seen = cosim("trace", "info", trace_of("auv-acoustic-naive"), cwd=tmp_path)
    assert seen.code == 0
    assert "uplink" in seen.out
    words = ("run", "paper-example", "--out", "seen.mcap", "--fmus", fmu_store())
    ran = cosim(*words, cwd=tmp_path)
    assert ran.code == 0
    assert "finished" in ran.out
    assert "not met" in ran.out
    assert "seen.mcap" in ran.out


def test_percentages_in_the_table_of_a_run_are_those_of_the_record(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Shares of the run, its envelope and the norm are printed in hundredths."""

    def ran(name: str) -> tuple[str, Any]:
        where = ("--flavour", "native", "--fmus", native_fmus.parent, "--out", f"{name}.mcap")
        seen = cosim("run", name, *where, cwd=tmp_path)
        assert seen.code == 0, seen.err
        reported = cosim("trace", "info", f"{name}.mcap", "--json", cwd=tmp_path)
        return seen.out, reported.json["result"]["metrics"]

    def percent(text: str, line: str) -> float:
        found = re.search(rf"{line}\D* ([\d.]+) %", text)
        assert found is not None, text
        return float(found[1])

    text, metrics = ran("auv-acoustic-naive")
    assert 0.5 < metrics["saturated_fraction"] < 1.0 < max(metrics["envelope_use"].values())
    at_limit = pytest.approx(100 * metrics["saturated_fraction"], abs=0.0501)
    assert percent(text, "time at a limit") == at_limit
    use = pytest.approx(100 * max(metrics["envelope_use"].values()), abs=0.0501)
    assert percent(text, "largest use of envelope") == use
    text, metrics = ran("paper-worst-case")
    reached = pytest.approx(100 * metrics["gain"] / metrics["exact_norm"], abs=0.00501)
    assert percent(text, r"worst case at [\d.]+ rad/s,") == reached


@pytest.mark.parametrize(
    "verb", [[], ["trace"], ["fmu"]], ids=["cosim", "cosim trace", "cosim fmu"]
)
def test_without_a_command_the_help_is_printed(verb: list[str], tmp_path: Path) -> None:
    """Without any verb the verbs are listed, and nothing is complained about."""
    result = cosim(*verb, cwd=tmp_path)
    assert "Usage" in result.out + result.err
    assert "Traceback" not in result.out + result.err


def test_demo_is_two_runs_and_a_picture(tmp_path: Path) -> None:
    """The demo flies the same runs as `run` does, draws them, and one of the two is covered."""
    result = cosim("demo", "--json", "--out", "demo", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 0, result.err
    runs = result.json["runs"]
    alone = cosim("run", "auv-survey", "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert runs["delay-aware"]["content_hash"] == alone.json["content_hash"]
    met = {label: run["metrics"]["assumptions"] for label, run in runs.items()}
    assert all(met["delay-aware"].values())
    assert [name for name, kept in met["naive"].items() if not kept] == [
        "age_of_usbl_within_design",
        "state_inside_envelope",
    ]
    picture = tmp_path / result.json["picture"]
    assert picture.read_bytes().startswith(b"\x89PNG")
