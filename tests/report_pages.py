"""A page of a report, read as a browser and a reader do: its words, and what its charts draw."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.report import write_report

Reals = NDArray[np.float64]


class _Texts(HTMLParser):
    """Words of a page outside of scripts and styles; and every address in it."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.addresses: list[str] = []
        self._silent = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._silent += tag in {"script", "style"}
        self.addresses += [v or "" for k, v in attrs if k in {"src", "href", "action", "srcset"}]

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in {"script", "style"}

    def handle_data(self, data: str) -> None:
        if not self._silent:
            self.words.append(data)


def words(text: str) -> str:
    """The words of a page."""
    return " ".join(" ".join(_Texts(text).words).split())


def addresses(text: str) -> list[str]:
    """Every address in a page."""
    return _Texts(text).addresses


@dataclass(frozen=True)
class Curve:
    """A line of a chart, or its marks.

    Attributes
    ----------
    t, values : [s] and in its unit, (m,), as they are drawn.
    packed : `x` and `y` as they are in the page.
    drawn : all of it, as plotly takes it.
    """

    label: str
    t: Reals
    values: Reals
    packed: tuple[dict[str, str], dict[str, str]]
    drawn: dict[str, Any]

    @property
    def stepwise(self) -> bool:
        """Whether values are drawn as steps."""
        return bool(self.drawn["line"]["shape"] == "hv")


@dataclass(frozen=True)
class Chart:
    """A chart: its title, its unit, its curves, and the label and value of its level lines."""

    title: str
    unit: str
    curves: list[Curve]
    bounds: list[tuple[str, float]]


class ReportPage:
    """A page.

    Attributes
    ----------
    text : all of it; `words` : those of it.
    tone, status, why : of the verdict on top; `why` : its first line, and the reason below it.
    figures : what its script draws: `span`, `paths`, and `charts` by key, as plotly takes them.
    charts : those over time, by key, in their order.
    """

    def __init__(self, path: Path) -> None:
        self.text = path.read_text("utf-8")
        self.words = words(self.text)
        badge = re.search(
            r'<span class="badge (\w+)">(?:<span class="tick[^>]*>.</span>)?(.*?)</span>', self.text
        )
        assert badge is not None
        self.tone, self.status = badge[1], html.unescape(badge[2].strip())
        answer = re.search(r'<p class="answer \w+">(.*?)</p>', self.text, re.DOTALL)
        reason = re.search(r'<p class="reason \w+">(.*?)</p>', self.text, re.DOTALL)
        why = (words(each[1]) for each in (answer, reason) if each is not None)
        self.why = " ".join(why)
        packed = re.search(r'id="figures">([^<]*)<', self.text)
        assert packed is not None
        self.figures: dict[str, Any] = json.loads(gzip.decompress(base64.b64decode(packed[1])))
        titles = re.findall(
            r"<figcaption><span>([^<]*)</span>(?: <span class=\"unit\">\[([^<]*)\]</span>)?"
            r'</figcaption>\n<div class="plot" id="[^"]*" data-chart="([^"]*)"',
            self.text,
        )
        self.charts: dict[str, Chart] = {}
        for title, unit, key in titles:
            data = self.figures["charts"][key]["data"]
            limits = [each for each in data if each["meta"]["role"] == "limit"]
            self.charts[key] = Chart(
                html.unescape(title),
                html.unescape(unit),
                [_curve(each) for each in data if each not in limits],
                [(each["name"], float(unpacked(each["y"])[0])) for each in limits],
            )
        assert set(self.charts) == set(self.figures["charts"])


def _curve(drawn: dict[str, Any]) -> Curve:
    x, y = drawn["x"], drawn["y"]
    return Curve(drawn["name"], unpacked(x), unpacked(y), (x, y), drawn)


def unpacked(packed: dict[str, str]) -> Reals:
    """Numbers as they are in a page."""
    kind = {"f4": "<f4", "f8": "<f8"}[packed["dtype"]]
    return np.frombuffer(base64.b64decode(packed["bdata"]), kind).astype(np.float64)


def report_of(trace: Path, folder: Path) -> ReportPage:
    """The report of a trace, written to a folder."""
    return ReportPage(write_report(trace, folder / f"{trace.name}.html").output)
