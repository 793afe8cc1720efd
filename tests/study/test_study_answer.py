"""What a study answers: where each condition was met, and over which runs that is."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from shared import fmu_store
from study.pages import chart_about, page_of, words
from study.studies_at_hand import study_folder

from cosim.study import read_table, summarise


def summary_of(name: str, *options: str) -> Any:
    """What `cosim study show` says of a study, as JSON."""
    return cosim("study", "show", str(study_folder(name)), "--json", *options, cwd=Path()).json


def test_points_are_counted_by_what_their_runs_did() -> None:
    """Of six points, eight runs each: in all, in some, in none, as the table has it."""
    fates = defaultdict(list)
    for row in read_table(study_folder("mixed"))[0].to_pylist():
        if row["small"] is not None:
            fates[row["x0"], row["decay"]].append(row["small"])
    counts = {
        "in all runs": sum(all(runs) for runs in fates.values()),
        "in some": sum(any(runs) and not all(runs) for runs in fates.values()),
        "in none": sum(not any(runs) for runs in fates.values()),
    }
    parts = [f"{word} at {n}" for word, n in counts.items() if n]
    parts[0] += f" of {len(fates)} points"
    found = summary_of("mixed")
    assert found["answer"] == found["answers"][0] == f"small: {', '.join(parts)}"
    assert found["pooling"].startswith("6 points with 8 draws each.")


def test_one_run_per_point_is_met_or_not(tmp_path: Path) -> None:
    """Over one axis the sentence has the ranges; the page leads with it, and has no interval."""
    rows = read_table(study_folder("few"))[0].to_pylist()
    small = [row["u"] for row in rows if row["small"]]
    assert small == [10.0, 50.0, 100.0]
    found = summary_of("few")
    assert found["answers"] == ["small: yes at 3 of 3 points (u 10 to 100)"]
    text = words(page_of(study_folder("few"), tmp_path / "few.html"))
    assert text.index("yes at 3 of 3 points (u 10 to 100)") < text.index("How the runs ended")
    assert "3 points, one run each: nothing is drawn at random" in text
    assert "95 %" not in text.partition("What was varied")[0]
    for group in found["groups"]:
        assert group["shares"]["small"]["low"] is None


def test_chosen_values_are_not_pooled(tmp_path: Path) -> None:
    """All runs of a grid together have no interval; each point has; the page says so, too."""
    table, manifest = read_table(study_folder("mixed"))
    (together,) = summarise(table, manifest, []).groups
    points = summarise(table, manifest, ["x0", "decay"])
    assert summarise(table, manifest, ["x0"]).mixed == ("decay",)
    assert points.mixed == ()
    assert {s.low for s in together.shares.values()} == {None}
    assert {n.low for n in together.numbers.values()} == {None}
    assert together.numbers["x"].mean is not None
    for group in points.groups:
        found = group.shares["small"]
        assert found.low is not None
        assert found.high is not None
        assert found.low < found.high
    text = words(page_of(study_folder("mixed"), tmp_path / "mixed.html"))
    assert "the points were chosen, and nothing is pooled over them" in text
    assert "Estimate of x over the number of draws" not in text


def test_draws_of_one_distribution_are_pooled(tmp_path: Path) -> None:
    """Without a grid the share has its interval, and the page says over how many runs."""
    found = summary_of("rare")
    assert found["pooling"] == "Pooled over 100 runs: all are draws from one distribution."
    assert "95 % interval" in found["answers"][0]
    text = words(page_of(study_folder("rare"), tmp_path / "rare.html"))
    assert "Pooled over 100 runs" in text


UNITS = """
title = "Two sea states, for a second"
scenario = "auv-direct"
set = { "run.end" = 1.0 }
[[vary]]
kind = "grid"
name = "Hs"
path = "components.sea.parameters.Hs"
values = [0.5, 1.0]
[metrics]
error = { signal = ["plant.eta.x", "plant.eta.y"], reduce = "rms" }
growth = { signal = "plant.nu.u", reduce = "growth_rate" }
speed = "final.plant.nu.u"
age = "metrics.message_age_s"
small = { path = "final.plant.eta.x", below = 1.0 }
"""


def test_charts_have_the_units_of_the_fmus(tmp_path: Path) -> None:
    """Axis and metrics have those of the variables that they are of; a truth has none."""
    (tmp_path / "units.toml").write_text(UNITS)
    fmus = str(fmu_store("native"))
    done = cosim("study", "run", "units.toml", "--out", "units", "--fmus", fmus, cwd=tmp_path)
    assert done.code == 0, done.err
    found = read_table(tmp_path / "units")[1]["units"]
    assert found == {"Hs": "m", "error": "m", "growth": "1/s", "speed": "m/s", "age": "s"}
    html = page_of(tmp_path / "units", tmp_path / "units.html")
    for metric in ("error [m]", "speed [m/s]", "small"):
        assert chart_about(html, metric, "Hs [m]")["data"]


@pytest.mark.parametrize("name", ["mixed", "few", "rare"])
def test_the_table_fits_a_terminal(name: str) -> None:
    """At 80 columns each row is one line with every axis; what is left out is in --details."""
    folder = str(study_folder(name))
    out = cosim("study", "show", folder, cwd=Path(), columns=80).out
    lines = out.splitlines()
    assert lines[1] == "next:"
    assert lines[2] == f"  cosim study report {folder}"
    assert all(len(line) <= 80 for line in lines[4:])
    if name == "rare":
        return
    groups = summary_of(name)["groups"]
    axes = list(groups[0]["where"])
    head = next(k for k, line in enumerate(lines) if line.split()[: len(axes)] == axes)
    for line, group in zip(lines[head + 1 :], groups, strict=False):
        assert line.split()[: len(axes)] == [f"{group['where'][axis]:g}" for axis in axes]
    details = cosim("study", "show", folder, "--details", cwd=Path()).out
    for metric in ("x", "small", "settled"):
        assert metric in details
