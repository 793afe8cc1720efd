"""Pictures of studies as files: the kind that fits, the kind that is asked for."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from study.studies_at_hand import study_folder

from cosim.core import InputError
from cosim.study import PICTURE_KINDS, draw_study, read_table


@pytest.mark.slow
def test_the_kind_that_fits_is_drawn(tmp_path: Path) -> None:
    """By the axes and the metric that there are; every other kind by its name, or says why not."""
    fitting = {"mixed": "map", "few": "curve", "indices": "sensitivity", "rare": "distribution"}
    for name, kind in fitting.items():
        assert draw_study(*read_table(study_folder(name)), tmp_path / f"{name}.png") == kind
        assert (tmp_path / f"{name}.png").stat().st_size > 5000
    with pytest.raises(InputError, match="no run has a value"):
        draw_study(*read_table(study_folder("dead")), tmp_path / "dead.png")
    mixed = read_table(study_folder("mixed"))
    refused = {}
    for kind in PICTURE_KINDS:
        target = tmp_path / f"{kind}.svg"
        try:
            draw_study(*mixed, target, kind)
        except InputError as error:
            refused[kind] = error.what
        assert target.exists() == (kind not in refused)
    assert set(refused) == {"boundary", "sensitivity"}
    text = (tmp_path / "distribution.svg").read_text("utf-8")
    assert "<svg" in text
    draw_study(*mixed, tmp_path / "words.png", "distribution", "outcome")
    draw_study(*mixed, tmp_path / "truths.png", "convergence", "small")
    draw_study(*mixed, tmp_path / "over.png", "scatter", "settled", ["u"])


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (("--kind", "cake"), "there is no picture 'cake'"),
        (("--kind", "convergence"), "draws nothing at random"),
        (("--kind", "map"), "nothing to draw this picture over"),
        (("--metric", "y"), "there is no metric 'y'"),
        (("--kind", "scatter", "--over", "v"), "there is no axis 'v'"),
    ],
)
def test_what_cannot_be_drawn_is_named(
    arguments: tuple[str, ...], cause: str, tmp_path: Path
) -> None:
    """Exit code 2, and no file."""
    line = ("study", "show", study_folder("few"), "--picture", "x.png", *arguments, "--json")
    found = cosim(*line, cwd=tmp_path)
    assert found.code == 2
    assert cause in found.error["what"]
    assert not (tmp_path / "x.png").exists()
