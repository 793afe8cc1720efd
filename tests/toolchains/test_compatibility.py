"""The compatibility page: what stands in it, and that it is about what there is."""

from __future__ import annotations

import importlib.metadata
from itertools import product
from pathlib import Path

import pytest
from toolchains import compatibility
from toolchains.compatibility import COLUMNS, Row

from cosim.fmu.export import CATALOGUE, FMI_VERSION

PAGE = Path(__file__).parents[2] / "docs" / "compatibility.md"


def test_the_page_has_every_tool_with_every_fmu_of_every_flavour() -> None:
    """A new FMU or flavour asks for a new page."""
    lines = [line.split(" | ") for line in PAGE.read_text("utf-8").splitlines()]
    rows = {(cells[0].removeprefix("| "), *cells[2:4]) for cells in lines if len(cells) > 4}
    tools = [title for title, _ in compatibility._TITLES.values()]
    assert set(product(tools, FMI_VERSION, CATALOGUE)) <= rows
    archives = PAGE.read_text("utf-8").partition("## SSP archives")[2].partition("\n1. ")[0]
    assert [tool for tool in tools if f"\n| {tool} | " not in archives] == []


def test_reasons_are_numbered_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is not installed is not tried; the same reason has one number."""
    cells = ("yes", "it crashes", "no such call", "no such call", "yes")
    made = [Row("FMPy", "1.0", "native", name, cells) for name in ("A", "B")]
    monkeypatch.setattr(compatibility, "rows", lambda: iter(made))
    archives = [("Ecos", "2.0", "yes", "no such call", "yes")]
    monkeypatch.setattr(compatibility, "archive_rows", lambda: iter(archives))
    text = compatibility.page()
    row = "| FMPy | 1.0 | native | B | yes | – (1) | – (2) | – (2) | yes |"
    assert row in text
    assert "1. it crashes\n2. no such call\n" in text
    assert "| Ecos | 2.0 | yes | – (2) | yes |" in text
    assert "| Ecos | it is not installed |" in text
    assert "| FMPy | it is" not in text


def test_a_cell_is_the_reason_of_a_run_that_fails() -> None:
    """The last line of what was said; skipped runs are not tried."""

    def fails() -> None:
        raise AssertionError("by_ecos ended with 1:\n  Traceback\nOSError: no library\n")

    def skips() -> None:
        pytest.skip("needs ecospy")

    assert compatibility._outcome(lambda: None) == "yes"
    assert compatibility._outcome(fails) == "OSError: no library"
    assert compatibility._outcome(skips) == "not tried: needs ecospy"
    assert compatibility._alone("yes") == ("yes", "it runs one FMU alone", "yes", "yes", "yes")
    assert len(COLUMNS) == 5


def test_a_tool_that_is_not_installed_has_no_row(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor are its runs begun."""

    def version(name: str) -> str:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(compatibility.importlib.metadata, "version", version)
    monkeypatch.setattr(compatibility, "_c_host", lambda _: "yes")
    monkeypatch.setattr(compatibility.shutil, "which", lambda _: None)
    assert {row.tool for row in compatibility.rows()} == {"C program"}
