"""`check_ssp`: whether an archive can be imported, and what other tools do not carry out."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from shared import fmu_store
from ssp.archives import LINKED, component, export, ssd, write

from cosim.core import InputError
from cosim.scenario import FmuCache, check_ssp, export_ssp, load, prepare


@pytest.mark.parametrize("links", ["annotate", "fmu"])
def test_links_that_are_annotations_are_named_and_those_that_are_fmus_are_not(
    native_fmus: Path, tmp_path: Path, links: str
) -> None:
    done = export(LINKED.format(events="grid"), native_fmus, tmp_path, links)  # type: ignore[arg-type]
    found = check_ssp(done.path)
    assert (found.version, found.components) == ("1.0", ("plant", "controller", "exosystem"))
    assert found.links == ("up-link", "downlink")
    assert found.connections == 4
    named = [sentence.split("'")[1] for sentence in found.only_here]
    assert named == (["downlink", "up-link"] if links == "annotate" else [])
    assert found.notes == ()


def test_parts_that_no_other_tool_carries_out_are_named(tmp_path: Path) -> None:
    """At the export, and of the archive: the same sentences."""
    prepared = prepare(load("docking"), FmuCache(fmu_store(), tmp_path))
    done = export_ssp(prepared, tmp_path / "docking.ssp", "fmu")
    found = check_ssp(done.path)
    tables = [sentence.partition(" ")[0] for sentence in found.only_here]
    assert tables == ["[assertions]", "[events]", "[modes]"]
    assert {*found.only_here} <= {*done.warnings}


def test_what_an_import_leaves_out_is_a_note_and_nothing_is_written(tmp_path: Path) -> None:
    fmu = (fmu_store() / "native" / "WaveField.fmu").read_bytes()
    text = ssd(f"<ssd:Elements>{component('sea', 'resources/sea.fmu')}</ssd:Elements>")
    entries = {"SystemStructure.ssd": text, "other.ssd": text, "resources/sea.fmu": fmu}
    path = write(tmp_path / "a.ssp", entries)
    found = check_ssp(path)
    assert any("other.ssd: another variant" in note for note in found.notes)
    assert any("no stop time" in note for note in found.notes)
    assert [*tmp_path.iterdir()] == [path]


def test_an_archive_that_cannot_be_imported_is_refused(tmp_path: Path) -> None:
    text = ssd(f"<ssd:Elements>{component('a', 'resources/none.fmu')}</ssd:Elements>")
    path = write(tmp_path / "a.ssp", {"SystemStructure.ssd": text})
    with pytest.raises(InputError, match="there is no such entry"):
        check_ssp(path)
    assert [*tmp_path.iterdir()] == [path]


def test_the_verb_shows_it_and_prints_json(native_fmus: Path, tmp_path: Path) -> None:
    export(LINKED.format(events="grid"), native_fmus, tmp_path)
    text = cosim("ssp", "check", "test.ssp", cwd=tmp_path)
    assert text.code == 0, text.err
    assert "can be imported: test.ssp, SSP 1.0" in text.out
    assert "link 'up-link' is an annotation" in " ".join(text.out.split())
    found = cosim("ssp", "check", "test.ssp", "--json", cwd=tmp_path).json
    assert {*found} == {
        *("answer", "ssp", "version", "components", "connections", "links", "only_here", "notes")
    }
    (tmp_path / "none.ssp").write_text("", "utf-8")
    assert cosim("ssp", "check", "none.ssp", cwd=tmp_path).code == 2
