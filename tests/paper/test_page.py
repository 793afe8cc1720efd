"""The report as JSON, as text and as a page, from a small report; the whole one is slow."""

from __future__ import annotations

import base64
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim as command
from rich.console import Console

import cosim.paper
from cosim.core import InputError
from cosim.models import paper_example as example
from cosim.paper import (
    SECTIONS,
    Report,
    Row,
    Verdict,
    curves,
    every_delay,
    figure_rows,
    lemma_rows,
    page,
    paper_view,
    table_2,
    table_rows,
)

VOID = {"meta", "col", "img", "br"}


class Structure(HTMLParser):
    """Tags that are opened and closed, and what the page points to."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sources: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in VOID:
            self.open.append(tag)
        self.sources += [value or "" for name, value in attrs if name in {"src", "href"}]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@pytest.fixture(scope="module")
def report() -> Report:
    """A report of one impossible and one possible column of Table 2, and a hostile row."""
    drawn, everywhere = curves(), every_delay(example.system())
    table = table_2(everywhere, lambda _what, _share: None, 2.0, (5.0, 20.0))
    odd = Row(SECTIONS[3], "<b>&", "<script>", "x < 1", None, Verdict.HOLDS, '"quoted"')
    rows = [*lemma_rows(), odd, *table_rows(table, everywhere), *figure_rows(drawn)]
    return Report(("One sentence.",), rows, table, drawn)


@pytest.mark.slow
def test_page_needs_no_other_file(report: Report) -> None:
    """Well-formed, nothing fetched, pictures inside and parseable, every row on it."""
    html = page(report)
    seen = Structure()
    seen.feed(html)
    assert seen.open == []
    assert seen.sources
    for source in seen.sources:
        kind, _, data = source.partition(";base64,")
        assert kind == "data:image/svg+xml"
        ET.fromstring(base64.b64decode(data))  # noqa: S314 - drawn here
    assert not re.search(r"@import|url\(|<link|<script", html)
    assert "&lt;script&gt;" in html
    text = "".join(seen.text)
    assert "Lemma 3 (iii)" in text
    assert "every delay" in text
    assert all(section in text for section in SECTIONS)


def test_page_is_the_same_twice(report: Report) -> None:
    assert page(report) == page(report)


def test_json_is_plain_and_complete(report: Report) -> None:
    """Strict JSON; verdicts from the closed set; one object per column of Table 2."""
    output = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert len(output["rows"]) == len(report.rows)
    assert {row["verdict"] for row in output["rows"]} <= {str(verdict) for verdict in Verdict}
    assert sum(output["verdicts"].values()) == len(output["rows"])
    assert [entry["gamma"] for entry in output["table2"]] == [5.0, 20.0]
    wanted = {
        "gamma",
        "printed",
        "corrected",
        "searched",
        "limit_reached",
        "bessel_legendre",
        "verdict",
    }
    assert all(wanted <= set(entry) for entry in output["table2"])


def test_view_has_every_row(report: Report) -> None:
    """In a narrow terminal too, and no text is taken for markup."""
    for width in (80, 200):
        console = Console(width=width, record=True, file=None, quiet=False, force_terminal=False)
        with console.capture() as captured:
            console.print(paper_view(report))
        assert "<script>" in captured.get()
        assert "Lemma 1" in captured.get()


TYPESET = {
    "k1 = -0.2": "k<sub>1</sub> = −0.2",
    "-2.40e-06": "−2.40×10<sup>−6</sup>",
    "PC + dA_KᵀRC": "PC + dA<sub>K</sub>ᵀRC",
    "Ω12": "Ω<sub>12</sub>",
    "S22 - S12ᵀ": "S<sub>22</sub> − S<sub>12</sub>ᵀ",
    "rows 1 to 4, Eq. (14)": "rows 1 to 4, Eq. (14)",
    "a < b & c": "a &lt; b &amp; c",
    "delay-independent": "delay-independent",
}


def test_typesetting(report: Report) -> None:
    """What a row prints has indices, powers and signs of mathematics, and no markup of its own."""
    rows = [
        Row(SECTIONS[0], f"claim {text}", text, text, None, Verdict.HOLDS, "") for text in TYPESET
    ]
    html = page(replace(report, rows=rows))
    for plain, typeset in TYPESET.items():
        assert html.count(f"claim {typeset}<") == 1, plain
        assert html.count(f">{typeset}<") == 2, plain


def test_help_names_the_command(tmp_path: Path) -> None:
    assert re.search(r"\bpaper\b", command("--help", cwd=tmp_path).out)
    assert "--html" in command("paper", "--help", cwd=tmp_path).out


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, report: Report) -> None:
    """The verb with the small report in place of the whole computation."""
    monkeypatch.setattr(cosim.paper, "reproduce", lambda _report_progress: report)


@pytest.mark.usefixtures("quick")
def test_command_writes_page_and_json(tmp_path: Path, report: Report) -> None:
    """Text, JSON, and a page beside either."""
    assert "Lemma 1" in command("paper", cwd=tmp_path).out
    result = command("paper", "--json", "--html", "new/page.html", cwd=tmp_path)
    assert result.code == 0
    found = result.json
    assert found.pop("answer").startswith(f"{len(report.rows)} claims of the paper computed anew")
    assert found == json.loads(json.dumps(report.to_json()))
    assert (tmp_path / "new" / "page.html").read_text("utf-8").startswith("<!doctype html>")


def test_unwritable_page_is_refused_before_the_computation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A page that cannot be written, or not be drawn: said before anything is computed."""

    def computed(_report_progress: Any) -> Report:
        raise AssertionError("computed before the fault was seen")

    def missing() -> None:
        raise InputError("pictures need matplotlib", hint="pip install 'auv-cosim[plot]'")

    monkeypatch.setattr(cosim.paper, "reproduce", computed)
    (tmp_path / "file").write_text("", "utf-8")
    for place, words in ((".", "is a folder"), ("file/page.html", "cannot be written")):
        result = command("paper", "--html", place, "--json", cwd=tmp_path)
        assert result.code == 2
        assert words in result.error["what"]
    monkeypatch.setattr(cosim.core, "pyplot", missing)
    result = command("paper", "--html", "page.html", "--json", cwd=tmp_path)
    assert result.code == 2
    assert "plot" in result.error["hint"]


@pytest.mark.slow
def test_whole_report(tmp_path: Path) -> None:
    """Every claim of MATH: the bound of 5, the norm, the roots, Table 2's seven columns."""
    result = command("paper", "--json", "--html", "page.html", cwd=tmp_path)
    assert result.code == 0
    output = result.json
    rows = {row["what"]: row for row in output["rows"]}
    assert len(rows) == len(output["rows"])
    assert rows["the least γ at k1 = 0.6, k2 = 0.2"]["value"] == pytest.approx(5.0132, abs=1e-4)
    assert 5.0 < rows["the least γ over k1, k2"]["value"] <= 5.001
    for name in ("the least γ at k1 = 0.6, k2 = 0.2", "the least γ over k1, k2"):
        assert rows[name]["verdict"] == "not comparable", "the paper chose γ = 5 and no least γ"
    norm = rows["(ii) with the printed K: ‖z‖ ≤ 5‖w‖"]
    assert norm["value"] == pytest.approx(5.0276, abs=1e-4)
    assert norm["verdict"] == "does not hold"
    measured = rows["(ii) in time, from rest"]
    assert 5.0 < measured["value"] <= norm["value"]
    stable = rows["(i) the closed loop with the printed K"]
    assert stable["value"] == pytest.approx(-5.138, abs=1e-3)
    assert stable["verdict"] == "holds"
    radius = rows["the closed loop with the printed K at other delays"]
    assert radius["value"] == pytest.approx(0.174, abs=5e-4), "published for section 5"
    table = output["table2"]
    assert [entry["gamma"] for entry in table] == [gamma for gamma, _ in example.TABLE_2]
    assert [entry["printed"] for entry in table] == [d for _, d in example.TABLE_2]
    for entry in table[:2]:
        assert entry["verdict"] == "cannot hold as printed"
        assert entry["corrected"] is None
        assert entry["searched"] is None
    for entry in table[2:]:
        assert entry["searched"] >= 10.0
        assert entry["every_delay"] is True
    assert table[2]["corrected"] == pytest.approx(1.0428, abs=1e-4)
    assert table[-1]["corrected"] == pytest.approx(1.2180, abs=1e-4)
    assert {row["verdict"] for row in output["rows"]} == {str(verdict) for verdict in Verdict}
    assert len(output["summary"]) == 5
    assert set(output["errors"]) <= set(rows), "each error is counted at a row of its own"
    assert all(rows[error]["errors"] == [error] for error in output["errors"])
    assert len(output["errors"]) == 20
    faulty = [row for row in output["rows"] if row["verdict"] not in ("holds", "not comparable")]
    assert {w for claims in output["errors"].values() for w in claims} == {
        r["what"] for r in faulty
    }
    assert (tmp_path / "page.html").stat().st_size > 100_000
