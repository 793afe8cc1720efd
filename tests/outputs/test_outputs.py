"""Outputs of the command line at places that are no plain files: a little of the table."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim
from outputs.every_output import OUTPUTS, Output, make_stock, options_of_outputs
from outputs.rows import Row, rows, try_row
from shared import made_once, sampled, share_of

from cosim.trace import TraceWriter

QUICK = {"run --out .mcap", "trace layout --out .json", "study run --out"}
PLACES = ("null", "a pipe", "a pipe alone", "a link", "anothers file")


def stock() -> Path:
    """What the commands read, made once per session."""
    return made_once("outputs", make_stock)


def test_every_output_is_judged_while_options_are_read(tmp_path: Path) -> None:
    """Before any work is done; and every one is in the table, as what it is."""
    known = {(output.verb, output.option): output.kind for output in OUTPUTS}
    found = {(verb, option): kind for verb, option, kind in options_of_outputs(tmp_path)}
    assert found == known


def tried(row: Row, tmp_path: Path) -> None:
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(folder.stat().st_mode | 0o111)
    found = try_row(row, stock(), tmp_path)
    if found.skipped:
        pytest.skip(found.skipped)
    assert found.ended is not None
    assert found.departures == (), found.ended.printed


@pytest.mark.parametrize(
    "row",
    sampled([row for row in rows() if row.output.name in QUICK and row.place in PLACES], 5),
    ids=lambda row: row.name,
)
def test_an_output_becomes_what_it_must(row: Row, tmp_path: Path) -> None:
    """A device, a pipe and a link stay what they are, and what is another's stays his."""
    tried(row, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("row", share_of(rows()), ids=lambda row: row.name)
def test_every_row_of_the_table(row: Row, tmp_path: Path) -> None:
    """`python -m tests.outputs.table` prints it."""
    tried(row, tmp_path)


TRACES = [output for output in OUTPUTS if output.kind == "trace"]


@pytest.mark.parametrize("output", TRACES, ids=lambda output: output.name)
def test_what_a_dead_run_left_is_set_aside_by_every_verb(output: Output, tmp_path: Path) -> None:
    """With the line that recovers it; while another run writes, the verb is refused."""
    path = tmp_path / "out.mcap"
    line = (*output.verb.split(), *output.arguments(stock()), output.option, path)
    left = (stock() / "cut.mcap.partial").read_bytes()
    partial = path.with_name("out.mcap.partial")
    partial.write_bytes(left)
    done = cosim(*line, cwd=tmp_path)
    assert done.code == output.usual, done.err
    aside = path.with_name("out.mcap.partial.1")
    assert aside.read_bytes() == left
    assert f"cosim trace recover {aside}" in done.err
    assert not partial.exists()
    before = path.read_bytes()
    with TraceWriter(path, run={}):
        refused = cosim(*line, cwd=tmp_path)
        assert refused.code == 2
        assert "is being written by another run" in refused.err
    assert path.read_bytes() == before
