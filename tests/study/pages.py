"""What pages about studies show: their words, and the figures that their script draws."""

from __future__ import annotations

import base64
import gzip
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.study import write_study_report


class _Texts(HTMLParser):
    """The words of a page, without scripts, styles and what is packed."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self._skipped = False

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        del attrs
        self._skipped = tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        del tag
        self._skipped = False

    def handle_data(self, data: str) -> None:
        if not self._skipped:
            self.words += data.split()


def words(html: str) -> str:
    """Return what a reader sees."""
    texts = _Texts()
    texts.feed(html)
    return " ".join(texts.words)


def page_of(folder: Path, target: Path) -> str:
    """Return the page about a study, written to the file `target`."""
    write_study_report(folder, target)
    return target.read_text("utf-8")


def figures_of(html: str) -> dict[str, Any]:
    """Return what the script of a page draws: runs, columns, charts by key, worst runs."""
    (packed,) = re.findall(r'id="figures">([^<]*)<', html)
    found: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(packed)))
    return found


def chart_about(html: str, metric: str, axis: str) -> dict[str, Any]:
    """Return the chart with these titles of its axes."""
    (found,) = (
        chart
        for chart in figures_of(html)["charts"].values()
        if chart["layout"].get("yaxis", {}).get("title") == metric
        and chart["layout"].get("xaxis", {}).get("title") == axis
    )
    return dict(found)


def numbers(packed: dict[str, Any]) -> NDArray[np.float64]:
    """Return numbers as they are packed for a chart."""
    found = np.frombuffer(base64.b64decode(packed["bdata"]), f"<{packed['dtype']}")
    shape = [int(size) for size in packed.get("shape", str(found.size)).split(",")]
    return found.astype(np.float64).reshape(shape)
