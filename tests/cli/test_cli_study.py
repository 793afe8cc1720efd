"""The verbs about studies, as a user types them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from study.deadly import folder

from cosim.study import execute_study

STUDY = """
title = "x follows u"
scenario = "{scenario}"
[[vary]]
kind = "grid"
name = "u"
path = "components.tiny.parameters.u"
values = [0.0, 1.0, 2.0]
[[vary]]
kind = "replicates"
name = "seed"
count = 2
[metrics]
x = "final.tiny.x"
small = {{ path = "final.tiny.x", below = 1.5 }}
"""


def study(path: Path) -> Path:
    """A study of six short runs."""
    file = path / "follows.toml"
    file.write_text(STUDY.format(scenario=folder() / "tiny.toml"))
    return file


def test_studies_are_listed_and_checked(tmp_path: Path) -> None:
    """Names and titles; and what one would do, without doing it."""
    rows = cosim("study", "list", "--json", cwd=tmp_path).json["studies"]
    assert {"delay-loss", "delay-margin", "sea-states"} <= {row["name"] for row in rows}
    assert "delay-margin" in cosim("study", "list", cwd=tmp_path).out
    study(tmp_path)
    reported = cosim("study", "check", "follows.toml", "--json", cwd=tmp_path).json
    assert reported["runs"] == 6
    assert reported["first"] == {"u": 0.0, "seed": 1}
    assert not (tmp_path / "studies").exists()
    assert "6 runs" in cosim("study", "check", "follows.toml", cwd=tmp_path).out


def test_parts_of_a_study_are_run_merged_and_displayed(tmp_path: Path) -> None:
    """A part says what it is of; what is missing, and what is not of the same study, is named."""
    study(tmp_path)
    run = ("study", "run", "follows.toml")
    first = cosim(*run, "--runs", ":2", "--out", "a", "--json", cwd=tmp_path).json
    assert (first["runs"], first["count"], first["results"]) == (2, 6, "a")
    assert "2 of 6" in cosim(*run, "--runs", "0:2", "--out", "a", cwd=tmp_path).out
    early = cosim("study", "merge", "a", "--out", "whole", cwd=tmp_path)
    assert "missing: --runs 2:6" in early.out
    cosim(*run, "--runs", "2:", "--out", "b", cwd=tmp_path)
    done = cosim("study", "merge", "a", "b", "--out", "whole", "--json", cwd=tmp_path).json
    assert (done["runs"], done["missing"], done["results"]) == (6, [], "whole/results.parquet")
    assert cosim("study", "show", "whole", "--json", cwd=tmp_path).json["complete"] is True
    refused = cosim(*run, "--runs", "2:9", cwd=tmp_path)
    assert refused.code == 2
    assert "within 0:6" in refused.err


def test_a_study_is_run_resumed_and_displayed(tmp_path: Path) -> None:
    """One JSON object each; the second time nothing is flown."""
    study(tmp_path)
    done = cosim("study", "run", "follows.toml", "--json", cwd=tmp_path).json
    assert (done["runs"], done["executed"], done["resumed"]) == (6, 6, 0)
    assert done["statuses"] == {"finished": 6}
    again = cosim(
        "study", "run", "follows.toml", "--traces", "worst:1 by x", "--json", cwd=tmp_path
    )
    assert (again.json["executed"], again.json["resumed"]) == (0, 6)
    assert list(again.json["traces"]) == ["4"]
    found = cosim("study", "show", "studies/follows", "--json", cwd=tmp_path).json
    assert found["complete"] is True
    assert [g["where"]["u"] for g in found["groups"]] == [0.0, 1.0, 2.0]
    assert [g["numbers"]["x"]["mean"] for g in found["groups"]] == pytest.approx(
        [0.9**20, 1.0, 2.0 - 0.9**20], rel=1e-14
    )
    assert [g["shares"]["small"]["share"] for g in found["groups"]] == [1.0, 1.0, 0.0]
    seen = cosim("study", "show", "studies/follows/results.parquet", cwd=tmp_path)
    assert seen.code == 0
    assert "x follows u" in seen.out
    drawn = cosim(
        *("study", "show", "studies/follows", "--metric", "x", "--over", "u"),
        *("--picture", "x.png", "--json"),
        cwd=tmp_path,
    )
    assert drawn.json["picture"] == "x.png"
    assert (tmp_path / "x.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("run", "follows.toml", "--workers", "none"), "not a number of workers"),
        (("run", "follows.toml", "--workers", "0"), "not a number of workers"),
        (("run", "follows.toml", "--traces", "best"), "not a valid choice of traces"),
        (("run", "follows.toml", "--samples", "99999999999"), "not a valid choice of samples"),
        (("run", "folows"), "there is no study 'folows'"),
        (("run", "follows.toml", "--scheduler", "tcp://127.0.0.1:9"), "no scheduler answers"),
        (("check", "nowhere.toml"), "cannot be read"),
        (("show", "nowhere"), "not the results of a study"),
        (("show", "."), "not the folder of a study"),
    ],
)
def test_bad_usage_is_named(tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    """Exit code 2, and the same in JSON."""
    study(tmp_path)
    result = cosim("study", *arguments, "--json", cwd=tmp_path)
    assert result.code == 2
    assert words in result.error["what"]


def test_options_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    """Options of `show`, an axis that is none, a picture of its own where there is none."""
    study(tmp_path)
    cosim("study", "run", "follows.toml", cwd=tmp_path)
    for arguments, words in (
        (("--metric", "x"), "are of a picture"),
        (("--by", "v"), "there is no axis 'v'"),
        (("--by", "u,"), "not a list of names"),
        (("--picture", "a.png", "--kind", "boundary"), "does not define a picture"),
        (("--picture", "a.png", "--metric", "y", "--over", "u"), "there is no metric 'y'"),
        (("--picture", "a.txt", "--metric", "x", "--over", "u"), "cannot be written"),
        (("--confidence", "95"), "not a confidence"),
    ):
        result = cosim("study", "show", "studies/follows", *arguments, "--json", cwd=tmp_path)
        assert result.code == 2
        assert words in result.error["what"]


def test_an_interruption_reports_what_is_kept_and_how_to_continue(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 130; the same command runs the rest."""
    study(tmp_path)

    def interrupted(*given: Any, **more: Any) -> Any:
        def look(what: str, _share: float) -> None:
            if what == "4 of 6 runs":
                raise KeyboardInterrupt

        return execute_study(*given, **more | {"progress": look})

    with monkeypatch.context() as patched:
        patched.setattr("cosim.study.execute_study", interrupted)
        stopped = cosim("study", "run", "follows.toml", "--json", cwd=tmp_path)
    assert stopped.code == 130
    assert stopped.error["got"] == "4 of 6 runs are done and kept"
    assert stopped.error["hint"] == "the same command continues"
    part = cosim("study", "show", "studies/follows", cwd=tmp_path)
    assert "(4 of 6 runs: the study is not finished)" in part.out
    assert cosim("study", "run", "follows.toml", "--json", cwd=tmp_path).json["executed"] == 2
