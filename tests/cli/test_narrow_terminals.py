"""On a narrow terminal, or through a pipe, no verb cuts off a figure or a name."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from pathlib import Path

import pytest
from cli.commands import every_command
from cli.shell import cosim, trace_of
from fmu.packed import described_as, files_of, pack
from rich.cells import cell_len
from shared import copied, fmu_store, sampled, spread
from study.deadly import folder as tiny_study

WIDE = 200
FIGURE = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?%?")
NOT_REPEATED = re.compile(r"(simulated|executed now,) in \S+ s")  # by the clock
STUDY = """
title = "x follows u"
scenario = "{scenario}"
{more}
[metrics]
x = "final.tiny.x"
small = {{ path = "final.tiny.x", below = 1.5 }}
the_end_is_beyond_the_start = {{ path = "final.tiny.x", above = 1.0 }}
"""
GRID = """
[[vary]]
kind = "grid"
name = "u"
path = "components.tiny.parameters.u"
values = [0.12345678901234567, 1.0, 2.0]
[[vary]]
kind = "replicates"
name = "seed"
count = 2
"""
AXIS = """
[[vary]]
kind = "{kind}"
name = "{name}"
path = "components.tiny.parameters.{name}"
uniform = [-1.0, 1.0]
"""
SYSTEM = """
[system]
A = [[0.0, 1.0], [0.0, -0.05]]
B = [[0.0], [1.0]]
[[system.delays]]
d = 2.4
feedback = true
any_age = true
"""
LOOP = """
[system]
A = [[0.5]]
B = [[1.0]]
C = [[1.0]]
D = [[1.0], [0.0]]
D2 = [[0.0], [0.3]]
"""
MODEM = "--bit-rate 1000 --packet 5 --range 15 --slot 0.1 --losses 1"

LINES = [
    "analyse paper",
    "certificate check {aware}",
    "certificate check held.json --system auv",
    "certificate prove paper.json --hold 0.01 --save new-held.json",
    "design paper",
    "fmu build paper -o new-plant.fmu",
    "fmu check wrong.fmu",
    "fmu controller paper.json -o new-paper.fmu",
    "fmu info wrong.fmu",
    "link fit buoy.csv",
    "link record {aware} -o new-uplink.csv",
    "link show one.csv",
    "link show {aware}",
    "link verdict buoy.csv --design outages.json --other 0.1",
    "migrate --check loop.toml",
    "run paper-example",
    "run paper-example --check-step",
    "scenario check paper-example",
    "scenario list",
    "ssp check paper.ssp",
    "ssp export paper-example -o new-paper.ssp",
    "ssp import paper.ssp -o new-back.toml",
    "study check follows.toml",
    "study list",
    "study merge follows --out new-merged",
    "study repeat follows.toml 0",
    "study report follows -o report.html",
    "study run follows.toml --out follows",
    "study sensitivity indices x",
    "study show follows --details",
    "study show follows --by u,seed --quantiles 0.05,0.95",
    "study show rare",
    "trace diff {aware} {naive}",
    "trace export {aware} --to ros2 -o new-bag.mcap",
    "trace export {aware} -o tables",
    "trace info cut.mcap",
    "trace info {aware}",
    "trace info {naive}",
    "trace inject {paper} --into DelayedPlant --compare plant -o new-fed.mcap",
    "trace layout {aware} -o new-layout.json",
    "trace recover cut.mcap -o new-mended.mcap",
    "trace report {paper} -o report.html",
    "trace rerun {paper}",
    "trace verify cut.mcap",
    "vehicle check wrong.toml",
    "vehicle list",
    "vehicle new new-mine",
    "vehicle show --keys",
    "vehicle show bluerov2-heavy --parameters",
]
SLOW = [
    f"age loop.toml {MODEM}",
    "demo",
    "paper",
    "run auv-acoustic-naive",
    "vehicle fly nps-auv2 --duration 60 --out flight",
]
NO_TABLE = {
    "scenario new": "lines of text",
    "scenario schema": "JSON",
    "scenario show": "TOML",
    "scenarios": "an older name",
    "study schema": "JSON",
    "trace cite": "text to copy, never wrapped",
    "trace play": "it serves until it is interrupted",
    "trace view": "it needs Rerun",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Real material for every verb."""
    home = tmp_path_factory.mktemp("narrow")
    (home / "fmus").symlink_to(fmu_store("native"))
    tiny = tiny_study() / "tiny.toml"
    studies = {
        "follows": GRID,
        "indices": "samples = 8\n" + "".join(
            AXIS.format(kind="saltelli", name=name) for name in ("u", "x0")
        ),
        "rare": 'samples = 100\nrare = { metric = "x", above = 0.9 }\n'
        + AXIS.format(kind="random", name="u"),
    }  # fmt: skip
    texts = {f"{n}.toml": STUDY.format(scenario=tiny, more=s) for n, s in studies.items()}
    texts |= {"system.toml": SYSTEM, "loop.toml": LOOP}
    texts["one.csv"] = "sent,delivered,node\n0,0.27,uplink\n"
    lost = [k % 17 in (3, 4, 5, 11) for k in range(900)]
    rows = (
        f"{k}," + ("" if gone else f"{k + 0.2 + k % 7 / 35:.6f}") for k, gone in enumerate(lost)
    )
    texts["buoy.csv"] = "\n".join(("sent,delivered", *rows, ""))
    for name, text in texts.items():
        (home / name).write_text(text, "utf-8")
    cut = copied(trace_of("auv-acoustic"), home / "cut.mcap")
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 3 // 5])
    files = files_of(fmu_store("native") / "native" / "AuvPlant.fmu")
    described_as((r'<Real unit="N" start="0.0" />', '<Real unit="N" />'))(files)
    pack(files, home / "wrong.fmu")
    for line in (
        "design paper --save paper.json",
        "certificate prove paper.json --hold 0.01 --save held.json",
        "analyse system.toml --gain [[-0.017361,-0.125]] --order 0 --outages --save outages.json",
        "ssp export paper-example -o paper.ssp",
        "vehicle new wrong",
        *(f"study run {name}.toml --out {name}" for name in studies),
    ):
        made = cosim(*line.split(), cwd=home)
        assert made.code == 0, made.err
    vehicle = home / "wrong.toml"
    vehicle.write_text(re.sub(r"(?m)^mass = .*", "mass = -1", vehicle.read_text("utf-8")), "utf-8")
    return home


def printed(line: str, width: int, folder: Path) -> str:
    """What a command prints on a terminal of this width."""
    traces = {"aware": "auv-acoustic", "naive": "auv-acoustic-naive", "paper": "paper-example"}
    words = [str(trace_of(traces[w[1:-1]])) if w[1:-1] in traces else w for w in line.split()]
    result = cosim(*words, cwd=folder, columns=width)
    assert result.code in {0, 1, 2, 3}, result.err
    for path in folder.glob("new-*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return result.out


def figures(text: str) -> Counter[str]:
    """The numbers that stand alone, whole."""
    words = (word.strip("[](),;:*") for word in text.split())
    return Counter(word for word in words if FIGURE.fullmatch(word))


def letters(text: str) -> Counter[str]:
    """Everything but white space and the lines of boxes."""
    return Counter(re.sub(r"[\s\u2500-\u257f]", "", text))


@pytest.mark.parametrize("line", sampled([*spread(LINES, 3), *SLOW], 17))
def test_no_figure_and_no_letter_is_lost(line: str, folder: Path) -> None:
    """Each number of the wide output stands whole in the narrow one, and nothing is cut."""
    wide = NOT_REPEATED.sub("", printed(line, WIDE, folder))
    assert wide
    for width in (80, 40):
        narrow = printed(line, width, folder)
        # a command is to be copied: it stands on one line
        lines = [one for one in narrow.splitlines() if not one.startswith("  cosim ")]
        assert max(map(cell_len, lines)) <= width
        assert "\N{HORIZONTAL ELLIPSIS}" not in narrow
        assert letters(wide) - letters(narrow) == Counter()
        assert figures(wide) - figures(narrow) == Counter()


def test_every_verb_that_prints_is_among_them() -> None:
    lines = [*LINES, *SLOW]
    leaves = {found.words for found in every_command() if found.is_leaf}
    unknown = {verb for verb in leaves if verb not in NO_TABLE}
    assert {v for v in unknown if not any(f"{n} ".startswith(f"{v} ") for n in lines)} == set()


def test_the_differences_of_two_traces_are_whole_in_a_pipe(folder: Path) -> None:
    """With the heading of the last column, and each instant with its unit on the same line."""
    out = printed("trace diff {aware} {naive}", 80, folder)
    (head,) = (line for line in out.splitlines() if line.startswith("signal "))
    assert head.split()[-2:] == ["relative", "at"]
    (first,) = (line for line in out.splitlines() if line.startswith("controller.force.x "))
    assert first.endswith("36.1152 s")
    narrow = printed("trace diff {aware} {naive}", 40, folder)
    assert re.search(r"signal +controller\.force\.x\s+differs at +0\.1 s\s", narrow)
    assert re.search(r"at +36\.1152 s\s", narrow)


def test_one_error_is_one_error(folder: Path) -> None:
    head = " ".join(printed("fmu info wrong.fmu", 80, folder).split())
    assert "; cosim fmu check: 1 error " in head


def test_one_message_has_no_interval(folder: Path) -> None:
    lines = printed("link show one.csv", 80, folder).splitlines()
    (line,) = (line for line in lines if line.startswith("messages  "))
    assert line.split() == ["messages", "1", "in", "0", "s"]


@pytest.mark.parametrize("width", [1, 2, 7, 15])
def test_a_terminal_may_be_as_narrow_as_it_likes(width: int, folder: Path) -> None:
    result = cosim("study", "show", "follows", "--details", cwd=folder, columns=width)
    assert result.code == 0
    if width > 2:
        assert letters(printed("study show follows --details", WIDE, folder)) <= letters(result.out)
