"""`cosim ssp`: what it prints, what it warns of, how it refuses."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from shared import fmu_store

SHORT = """
title = "Section 5 over a link"
[run]
end = 0.5
step = 0.01
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
[[connections]]
from = "plant.x"
to = "controller.x"
link = "uplink"
[[connections]]
from = "controller.u"
to = "plant.u"
[links.uplink]
kind = "packet"
sample_time = 0.02
delay = 0.03
loss = 0.1
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "short.toml").write_text(SHORT, "utf-8")
    return tmp_path


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_scenario_is_exported_and_imported_again(folder: Path, links: str) -> None:
    """One JSON object each; the scenario that comes back flies."""
    out = cosim(
        *("ssp", "export", "short.toml", "-o", "out.ssp", "--links", links, "--json"),
        *("--fmus", fmu_store()),
        cwd=folder,
    )
    assert out.code == 0, out.err
    assert set(out.json) == {
        *(
            "answer",
            "ssp",
            "components",
            "connections",
            "links",
            "resources",
            "step",
            "end",
            "warnings",
        )
    }
    assert out.json["links"] == {"uplink": {"annotate": "annotation", "fmu": "FMU"}[links]}
    warned = any("other tools ignore the links uplink" in w for w in out.json["warnings"])
    assert warned == (links == "annotate")
    assert ("warning" in out.err) == warned
    back = cosim("ssp", "import", "out.ssp", "-o", "back.toml", "--json", cwd=folder)
    assert back.code == 0, back.err
    assert back.json["components"] == {"plant": "plant", "controller": "controller"}
    assert back.json["links"] == ["uplink"]
    assert back.json["unsupported"] == []
    ran = cosim("run", "back.toml", "--json", cwd=folder)
    assert ran.code == 0, ran.err
    assert ran.json["links"]["uplink"]["sent"] == 26


def test_text_output_shows_what_was_written(folder: Path) -> None:
    out = cosim("ssp", "export", "short.toml", "--fmus", fmu_store(), cwd=folder)
    assert out.code == 0
    assert "short.ssp" in out.out
    assert "uplink" in out.out
    assert "--links fmu" in out.err
    back = cosim("ssp", "import", "short.ssp", "-o", "again.toml", cwd=folder)
    assert back.code == 0
    assert "again.toml" in back.out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("export", "none.toml"), "none.toml"),
        (("export", "paper-exampel"), "no scenario"),
        (("export", "short.toml", "--links", "wires"), "--links"),
        (("export", "short.toml", "-o", "short.toml"), "would overwrite"),
        (("import", "none.ssp"), "none.ssp"),
        (("import", "short.toml", "-o", "new.toml"), "not an SSP archive"),
        (("import", "short.toml"), "already exists"),
        (("import", "short.toml", "-o", "short.toml"), "would overwrite"),
        (("import", "short.toml", "--step", "0"), "--step"),
    ],
)
def test_bad_use_is_refused_in_one_object(
    folder: Path, words: tuple[str, ...], message: str
) -> None:
    done = cosim("ssp", *words, "--json", cwd=folder)
    assert done.code == 2
    assert message in str(done.error)


def test_help_shows_examples(folder: Path) -> None:
    for verb in ("export", "import"):
        done = cosim("ssp", verb, "--help", cwd=folder)
        assert done.code == 0
        assert f"cosim ssp {verb} " in done.out
