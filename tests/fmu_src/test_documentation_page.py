"""The documentation page inside an FMU: complete and offline, and its programs run."""

from __future__ import annotations

import html
import re
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from cli.shell import cosim
from lxml import etree
from shared import fmu_folder

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE

NAMES = sorted(CATALOGUE)
MATHML = "{http://www.w3.org/1998/Math/MathML}"


def page_of(name: str) -> str:
    return page_in(fmu_folder("native") / f"{name}.fmu")


def page_in(path: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        return archive.read("documentation/index.html").decode()


def page_with(notes: str, folder: Path) -> str:
    """What the page of a component makes of its notes."""
    begin, end = "THE BEGIN", "THE END"
    spec = replace(CATALOGUE["AuvPlant"], notes=f"{begin}\n\n{notes}\n{end}\n")
    page = page_in(build_fmu(spec, folder, "python"))
    return page.partition(begin)[2].partition(end)[0]


def programs(page: str, language: str) -> list[str]:
    pattern = f'<pre><code class="language-{language}">(.*?)</code></pre>'
    return [html.unescape(found) for found in re.findall(pattern, page, re.DOTALL)]


@pytest.mark.parametrize("name", NAMES)
def test_page_loads_nothing_external(name: str) -> None:
    """The only address is the MathML namespace; links lead into the page or to the licence."""
    page = page_of(name)
    assert set(re.findall(r"https?://[^\"\s<]+", page)) == {"http://www.w3.org/1998/Math/MathML"}
    anchors = set(re.findall(r'id="([^"]+)"', page))
    for target in re.findall(r'href="([^"]+)"', page):
        assert target == "licenses/license.txt" or target.removeprefix("#") in anchors
    assert set(re.findall(r'src="(.{22})', page)) == {"data:image/png;base64,"}


@pytest.mark.parametrize("name", NAMES)
def test_equations_become_mathml(name: str) -> None:
    """MathML that parses, and no LaTeX or Markdown left in the text."""
    page = page_of(name)
    equations = re.findall(r"<math .*?</math>", page, re.DOTALL)
    assert equations
    for equation in equations:
        root = etree.fromstring(equation)
        assert root.tag == f"{MATHML}math"
        assert not root.findall(f".//{MATHML}merror")
        assert "\\" not in "".join(root.itertext())
    text = re.sub(r"<pre>.*?</pre>|<style>.*?</style>|<math .*?</math>", "", page, flags=re.DOTALL)
    assert "```" not in text
    assert "\\" not in text


def test_a_dotted_letter_and_a_matrix_are_readable_without_a_mathematical_font(
    tmp_path: Path,
) -> None:
    """The dot belongs to the letter, Latin and Greek; brackets are the table's."""
    latex = "\\dot{x} = \\dot\\psi \\begin{bmatrix} 1 & 2 \\end{bmatrix}"
    page = page_with(f"```math\n{latex}\n```\n", tmp_path)
    assert "<mi>\N{MATHEMATICAL ITALIC SMALL X}\u0307</mi>" in page
    assert "<mi>\N{MATHEMATICAL ITALIC SMALL PSI}\u0307</mi>" in page
    assert '<mtable class="matrix">' in page
    assert "[" not in re.sub("<[^>]*>", "", page)


def test_html_in_a_text_is_escaped(tmp_path: Path) -> None:
    """A component's text cannot add markup to the page."""
    text = "<script>alert(1)</script>\n\n    <b>\n\n```toml\n</code><i>\n```\n"
    page = page_with(text, tmp_path)
    assert "alert(1)" in page
    assert not re.search("<(script|b|i)>", page)


@pytest.mark.parametrize("name", NAMES)
def test_every_start_value_can_be_read_exactly(name: str) -> None:
    """Entries of a matrix have their double as a title; a table shows six digits or all."""
    page = page_of(name)
    page = page[page.index('<h2 id="variables">') :]
    for v in CATALOGUE[name].variables:
        if re.search(r"\[\d+,\d+\]", v.name):
            assert f'title="{v.name} = {v.start!r}: ' in page
        else:
            row = page[page.index(f"<code>{v.name}</code></td>") :]
            cells = re.findall(r"<td[^>]*>(.*?)</td>", row)
            printed = float(cells[1].replace("−", "-"))
            assert printed == pytest.approx(v.start, rel=5e-6, abs=0)
            assert (cells[0] != "–") == (v.unit is not None)


@pytest.mark.parametrize("name", NAMES)
def test_the_fmpy_program_runs(name: str, native_fmus: Path) -> None:
    """Unchanged, beside the FMU: it prints two numbers, the first of them the end time."""
    (program,) = programs(page_of(name), "python")
    done = subprocess.run(  # noqa: S603 - what the page tells people to type
        [sys.executable, "-W", "error", "-c", program],
        cwd=native_fmus,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    end, value = map(float, done.stdout.split())
    assert end == CATALOGUE[name].stop_time
    assert value != 0.0


@pytest.mark.parametrize("name", NAMES)
def test_the_scenario_runs(name: str, fmus: Path, tmp_path: Path) -> None:
    """Unchanged except for a shorter end, with the built-in FMUs that it names."""
    (scenario,) = programs(page_of(name), "toml")
    short = re.sub(r"end = [\d.]+", "end = 1.0", scenario)
    (tmp_path / "my-scenario.toml").write_text(short, "utf-8")
    run = cosim("run", "my-scenario.toml", "--fmus", fmus.parent, "--json", cwd=tmp_path)
    assert run.code == 0, run.err
    assert run.json["status"] == "finished"


def test_the_page_is_in_every_flavour(fmus: Path, native_fmus: Path) -> None:
    """One page, whatever the FMU is made of."""
    pages = [page_in(folder / "PaperController.fmu") for folder in (fmus, native_fmus)]
    assert pages[0] == pages[1]
