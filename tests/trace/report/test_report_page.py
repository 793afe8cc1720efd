"""The report in a browser: drawn, quiet, without the network, in the dark and on a phone."""

from __future__ import annotations

import base64
import gzip
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.shell import shared_run, trace_of
from outcomes.ways import found
from report_browser import Page, browser, needs_chromium
from report_files import foreign
from shared import sampled

from cosim.trace.report import write_comparison, write_report

pytestmark = needs_chromium

DRAWN = """[...document.querySelectorAll('.plot')].filter(
    (div) => !div.closest('details:not([open])') && !div.querySelector('.main-svg, canvas')
).map((div) => div.id)"""
RANGES = """[...document.querySelectorAll('[data-chart]')].filter((div) => div.layout)
    .map((div) => div.layout.xaxis.range.map(Number))"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One browser for all tests of this file."""
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


PAPER = ("paper-example", "paper-worst-case")


class Reports(dict[str, Path]):
    """Reports of every kind of trace, made when they are first asked for."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __missing__(self, name: str) -> Path:
        target = self._folder / f"{name}.html"
        recorded = trace_of("auv-acoustic-naive")
        match name:
            case "compared":
                write_comparison(*map(trace_of, PAPER), target)
            case "vehicles":
                write_comparison(trace_of("auv-acoustic"), recorded, target)
            case "cut":
                cut = self._folder / "cut.mcap.partial"
                cut.write_bytes(recorded.read_bytes()[: recorded.stat().st_size // 2])
                write_report(cut, target)
            case "foreign":
                write_report(foreign(self._folder / "foreign.mcap"), target)
            case _:
                kinds = {"vehicle": recorded, "paper": trace_of("paper-example")}
                if name == "outages":
                    kinds[name] = trace_of("survey-outages")
                write_report(kinds.get(name) or found(name).trace, target)
        self[name] = target
        return target


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """One folder of reports for all tests of this file."""
    return Reports(tmp_path_factory.mktemp("reports"))


KINDS = ("far", "paper", "cut", "foreign", "vehicles")
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in KINDS]


@pytest.mark.parametrize("name", ["vehicle", *SLOW])
def test_every_chart_is_drawn_without_errors_or_requests(
    name: str, page: Page, reports: Reports
) -> None:
    """No error on the console, no request to anywhere, nothing left empty, light and dark."""
    page.errors.clear()
    page.asked.clear()
    page.open(reports[name], scheme="dark" if name == "far" else "light")
    assert page.ask(DRAWN) == []
    assert page.ask("document.querySelectorAll('.plot .main-svg').length") > 0
    page.ask("document.getElementById('theme').click()")
    page.ask("window.dispatchEvent(new Event('beforeprint'))")
    page.ask("window.dispatchEvent(new Event('afterprint'))")
    assert page.errors == []
    assert page.asked == []


def test_browser_errors_and_requests_are_noticed(page: Page, tmp_path: Path) -> None:
    """A page that throws, and one that asks for something outside, are noted."""
    bad = tmp_path / "bad.html"
    bad.write_text(
        "<!doctype html><html data-ready=yes><img src='http://127.0.0.1:9/x.png'>"
        "<script>console.error('oh'); throw new Error('no')</script></html>"
    )
    page.errors.clear()
    page.asked.clear()
    page.open(bad)
    page.ask("new Promise((done) => setTimeout(done, 200))")
    assert any("oh" in error for error in page.errors)
    assert any("no" in error for error in page.errors)
    assert page.asked == ["http://127.0.0.1:9/x.png"]
    page.errors.clear()
    page.asked.clear()


@pytest.mark.parametrize(
    ("name", "width", "scheme"),
    sampled(
        [
            ("vehicle", 1400, "light"),
            ("compared", 390, "dark"),
            ("vehicle", 390, "light"),
            ("compared", 1400, "dark"),
        ],
        2,
    ),
)
def test_a_page_fits_its_screen_and_bars_are_to_scale(
    name: str, width: int, scheme: str, page: Page, reports: Reports
) -> None:
    """Nothing sticks out sideways; gain, norm and bound, of both runs, are as long as they are."""
    runs = ["auv-acoustic-naive"] if name == "vehicle" else PAPER
    metrics = [shared_run(run).json["metrics"] for run in runs]
    values = [one[key] for key in ("gain", "exact_norm", "gamma") for one in metrics]
    page.errors.clear()
    page.open(reports[name], width=width, scheme=scheme)
    assert page.ask("document.documentElement.scrollWidth") <= width
    assert page.ask(DRAWN) == []
    assert page.errors == []
    bars = "[...document.querySelectorAll('.bars .bar')]"
    drawn = page.ask(f"{bars}.map((bar) => bar.getBoundingClientRect().width)")
    longest = max(drawn)
    assert longest > 100
    wanted = [longest * value / max(values) for value in values]
    assert drawn == pytest.approx(wanted, abs=0.5)
    assert min(wanted) < 0.9 * longest
    # on either background they are seen, and the two runs are told apart
    ground = page.ask("getComputedStyle(document.querySelector('.card')).backgroundColor")
    colours = page.ask(f"{bars}.map((bar) => getComputedStyle(bar).backgroundColor)")
    assert (ground == "rgb(255, 255, 255)") == (scheme == "light")
    assert ground not in colours
    assert colours[0] != colours[1]
    assert name == "vehicle" or colours[:2] * 3 == colours


def test_the_first_screen_answers_and_the_rest_is_folded(page: Page, reports: Reports) -> None:
    """At 1400 x 900 verdict, key figures and path need no scrolling; the whole page 2,500 px."""
    page.open(reports["vehicle"], width=1400)
    ends = page.ask("""['.badge', '.bars', '.first .facts', '#plan', '#link-states'].map((part) =>
        document.querySelector(part).getBoundingClientRect().bottom)""")
    assert max(ends) <= 900
    assert page.ask("document.documentElement.scrollHeight") <= 2500
    # a link to what is folded unfolds it
    page.ask("location.hash = '#provenance'")
    page.ask("new Promise((done) => setTimeout(done, 300))")
    assert page.ask("document.querySelector('#provenance details').open")


def test_all_of_it_is_printed(page: Page, reports: Reports) -> None:
    """Printing unfolds every part and draws its charts; afterwards all is as it was."""
    page.open(reports["paper"])
    folded = "[...document.querySelectorAll('details')].filter((part) => !part.open).length"
    before = page.ask(folded)
    assert before > 2
    page.ask("window.dispatchEvent(new Event('beforeprint'))")
    assert page.ask(folded) == 0
    assert page.ask(DRAWN) == []
    page.ask("window.dispatchEvent(new Event('afterprint'))")
    assert page.ask(folded) == before


@pytest.mark.slow
def test_long_words_squeeze_no_column(page: Page, reports: Reports) -> None:
    """What proves a figure is read beside it, however long the figure is; numbers stay whole."""
    for width in (1300, 390):
        page.open(reports["outages"], width=width, scheme="light")
        page.ask("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
        cells = "[...document.querySelectorAll('.facts tr')].map((row) => row.lastElementChild)"
        widths = page.ask(f"{cells}.map((cell) => cell.getBoundingClientRect().width)")
        assert len(widths) > 8
        assert min(widths) >= 100
        assert page.ask("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_dark_and_light_change_charts_too(page: Page, reports: Reports) -> None:
    """The system's setting applies until the button is used; the zoom is kept."""
    colours = """(() => { const div = document.querySelector('[data-chart]');
        return [getComputedStyle(document.body).backgroundColor, div.layout.font.color,
                div.data[0].line.color]; })()"""
    page.open(reports["paper"], scheme="light")
    light = page.ask(colours)
    page.call(
        "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    page.ask("new Promise((done) => setTimeout(done, 300))")
    dark = page.ask(colours)
    assert all(a != b for a, b in zip(light, dark, strict=True))
    page.ask("document.querySelector('[data-move=in]').click()")
    page.ask("new Promise((done) => setTimeout(done, 300))")
    page.ask("document.getElementById('theme').click()")
    assert page.ask(colours) == light
    assert page.ask(RANGES)[0] == [2.5, 7.5]


@pytest.mark.slow
def test_all_time_axes_move_together(page: Page, reports: Reports) -> None:
    """Zooming one chart, typing a time, and the buttons: every chart over time follows."""
    page.open(reports["vehicle"])
    charts = page.ask("document.querySelectorAll('[data-chart]').length")
    settled = "new Promise((done) => setTimeout(done, 500))"
    page.ask("document.querySelector('#vehicle details').open = true")
    page.ask(settled)
    page.ask("""Plotly.relayout([...document.querySelectorAll('#vehicle [data-chart]')][3],
        {'xaxis.range[0]': 10, 'xaxis.range[1]': 20}).then(() => true)""")
    page.ask(settled)
    ranges = page.ask(RANGES)
    assert 1 < len(ranges) <= charts
    assert all(r == [10, 20] for r in ranges)
    page.ask("""(() => { const field = document.getElementById('to'); field.value = 30;
        field.dispatchEvent(new Event('change', {bubbles: true})); })()""")
    page.ask(settled)
    assert all(r == [10, 30] for r in page.ask(RANGES))
    # what was folded away comes with the same window
    page.ask("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    page.ask(settled)
    assert len(page.ask(RANGES)) == charts
    assert all(r == [10, 30] for r in page.ask(RANGES))
    page.ask("document.querySelector('[data-move=all]').click()")
    page.ask(settled)
    assert all(r == [0, 180] for r in page.ask(RANGES))


def test_everything_works_by_keyboard(page: Page, reports: Reports) -> None:
    """Links, buttons, fields and folds take the focus; every chart has a text in its place."""
    page.open(reports["paper"])
    focused = page.ask("""[...document.querySelectorAll('a[href], button, input, summary')].filter(
        (part) => !part.closest('.plot') && part.tabIndex < 0).length""")
    assert focused == 0
    assert page.ask("""[...document.querySelectorAll('.plot')].every(
        (div) => div.getAttribute('aria-label').length > 20)""")
    assert page.ask("""[...document.querySelectorAll('a[href^="#"]')].every(
        (link) => document.getElementById(link.hash.slice(1)))""")


def test_a_page_that_cannot_be_drawn_says_why(page: Page, reports: Reports, tmp_path: Path) -> None:
    """Another script in the place of the library is not run; an old browser is named."""
    html = reports["paper"].read_text("utf-8")
    other = base64.b64encode(gzip.compress(b"window.Plotly = {}; window.ran = true")).decode()
    changed = tmp_path / "changed.html"
    changed.write_text(re.sub(r'(id="library">)[^<]*', rf"\1{other}", html), "utf-8")
    note = "document.getElementById('undrawn').textContent"
    page.open(changed, ready="undrawn")
    assert page.ask("window.ran") is None
    assert "the library did not start" in page.ask(note)
    page.errors.clear()
    old = page.call(
        "Page.addScriptToEvaluateOnNewDocument", source="delete window.DecompressionStream"
    )
    try:
        page.open(reports["paper"], ready="undrawn")
        assert "need a newer browser" in page.ask(note)
        assert page.ask("document.getElementById('undrawn').checkVisibility()")
        assert page.errors == []
    finally:
        page.call("Page.removeScriptToEvaluateOnNewDocument", identifier=old["identifier"])


@pytest.mark.slow
def test_path_is_drawn_without_webgl(tmp_path: Path, reports: Reports) -> None:
    """A browser that cannot draw in space shows the path from one side."""
    with browser(tmp_path / "profile", "--disable-3d-apis") as page:
        page.open(reports["vehicle"])
        page.ask("document.querySelector('#vehicle details').open = true")
        page.ask("new Promise((done) => setTimeout(done, 1500))")
        assert page.ask("document.getElementById('space').data.map((d) => d.type)[0]") == "scatter"
        assert page.ask("document.querySelectorAll('#space .scatterlayer path').length") > 0
        assert page.errors == []
