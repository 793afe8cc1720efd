"""What each tool does with our FMUs and SSP archives, from runs: the page docs/compatibility.md.

    python -m tests.toolchains.compatibility docs/compatibility.md

A tool that is not installed is on the page as not tried, with the reason. The runs are those of
the tests beside this file; a cell is "yes" where the tool gives the figures of our own master.
"""

from __future__ import annotations

import importlib.metadata
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from shared import fmu_folder, share_below  # noqa: E402 - the folder of tests is on the path now
from toolchains import test_c_host, test_ssp_peers, test_toolchains as runs  # noqa: E402
from toolchains.peer_run import TOOLS, Part, PeerRun, Tool, run_peer  # noqa: E402
from toolchains.ssp_peer_run import PEERS, Peer  # noqa: E402

from cosim.fmu.export import CATALOGUE, FMI_VERSION  # noqa: E402
from cosim.fmu.inspect import inspect_fmu, run_findings  # noqa: E402

ARCHIVES = ("no links", "link FMUs", "a vehicle over link FMUs")
COLUMNS = ("load", "loop", "state", "reset", "two instances")
_STEP_NS, _STEPS = 20_000_000, 25
_TITLES = {
    "fmpy": ("FMPy", "FMPy"),
    "libcosim": ("libcosim", "libcosimpy"),
    "ecos": ("Ecos", "ecospy"),
    "container": ("FMUContainer", "fmu-manipulation-toolbox"),
}
_NO_STATE = {
    "libcosim": "libcosim has no call that saves a state",
    "ecos": "Ecos has no call that saves a state",
    "container": "a container declares canGetAndSetFMUstate=false",
}
NOT_TRIED = {
    "OMSimulator": "its package loads its binaries from outside the package registry",
    "PyFMI": "its package has no wheel, and building it needs the FMI Library in C",
    "Simulink": "a commercial product; [Simulink](how-to/simulink.md) follows its documentation",
    "Windows binaries": "Wine was not available where this page was made",
}
_HEAD = """\
# Compatibility

What each tool does with each FMU of this project, and with its archives. This page is made from
runs, by `python -m tests.toolchains.compatibility docs/compatibility.md` (extra `toolchains`).

- **load**: the tool loads the FMU and steps it; its outputs are those of our own master to 1e-9.
- **loop**: the same holds for the closed loop that the FMU belongs to: section 5 of the paper, or
  the vehicle with its controller in waves.
- **state**: after its state is saved, restored and serialised, the FMU gives the same bits.
- **reset**: after a reset the same run gives the same figures.
- **two instances**: two instances in one run, with different parameters, do not disturb each other.

The reason for a dash is below the tables.
"""


_SYSTEMS = """\
## Systems

What was done for each. A binary that was compiled for a system but never loaded there can still
fail there; [the master](explanation/master.md) says what each system lacks by design.

| system | binaries of FMUs and of the loop | the package | the tests |
|---|---|---|---|
| Linux x86_64 | compiled and run | run, from the wheel and from a clone | run |
| Linux aarch64 | cross-compiled; FMUs run by a C program | never installed | never run |
| Windows x86_64 | cross-compiled, never loaded | simulated on Linux | never run |
| macOS x86_64, aarch64 | cross-compiled, never loaded | simulated on Linux | never run |

Never loaded: tests read the headers, imports and exports of these binaries. Simulated: on Linux
without fork, process groups and locks, without a home, in the code page of Windows; a workflow for
each of the two systems is written, but has never run.

The container file was built and run once by Buildah, with a stand-in for its base image: its first
lines say how.
"""

_OF_OTHERS = """\
## FMUs of other tools

This master runs these FMUs, whatever tool made them; `cosim fmu check` reads all of them.

| FMI | co-simulation | model exchange | what it lacks by its standard |
|---|---|---|---|
| 1.0 | yes | refused | saved states, with snapshots and solved loops; log categories |
| 2.0 | yes | refused | Clocks, arrays, event mode |
| 3.0 | yes, also scheduled execution | refused | |
"""

_ARCHIVES_HEAD = """\
## SSP archives

What each tool does with archives of `cosim ssp export`, unedited: section 5 of the paper, the same
over links that lose, delay and quantize as FMUs, and the vehicle with its designed gain, a sea, a
path to follow and two lossy links. "yes": its outputs are those of our own master to 1e-9 of their
size. (FMPy sets all inputs to zero in the first step, which gives another run of the vehicle.)
"""


class Row(NamedTuple):
    """A line of the table; a cell is "yes" or the reason why it is not."""

    tool: str
    version: str
    flavour: str
    fmu: str
    cells: tuple[str, ...]


def rows() -> Iterator[Row]:
    """Run every tool with every FMU of every flavour."""
    for key, tool in TOOLS.items():
        title, package = _TITLES[key]
        with suppress(importlib.metadata.PackageNotFoundError):
            version = importlib.metadata.version(package)
            for flavour in FMI_VERSION:
                for name in CATALOGUE:
                    yield Row(title, version, flavour, name, _cells(key, tool, flavour, name))
    for name in CATALOGUE:
        yield Row("C program", "C99", "native", name, _alone(_c_host(name)))
    qemu = shutil.which("qemu-aarch64")
    if qemu is not None and test_c_host.ARM_ROOT.is_dir():
        for name in CATALOGUE:
            cells = _alone(_arm_host(name))
            yield Row("C program on aarch64", "qemu-user", "native", name, cells)


def archive_rows() -> Iterator[tuple[str, ...]]:
    """Run every tool with every archive: tool, version, and a cell for each."""
    for key, peer in PEERS.items():
        title, package = _TITLES[key]
        with suppress(importlib.metadata.PackageNotFoundError):
            cells = (_archive(peer, archive) for archive in ARCHIVES)
            yield (title, importlib.metadata.version(package), *cells)


def _archive(peer: Peer, archive: str) -> str:
    of_vehicle = archive == ARCHIVES[-1]
    if of_vehicle and not peer.bound:
        return "it sets no parameters of an archive"
    with tempfile.TemporaryDirectory() as folder:
        given = fmu_folder("native"), Path(folder), peer
        if of_vehicle:
            run = test_ssp_peers.test_vehicle_over_its_acoustic_links_runs_elsewhere_as_here
            return _outcome(lambda: run(*given))
        return _outcome(lambda: test_ssp_peers.test_archive_runs_elsewhere_as_here(*given, archive))


def _alone(outcome: str) -> tuple[str, ...]:
    """Return the cells of a program that has but one kind of FMU."""
    return tuple("it runs one FMU alone" if c == "loop" else outcome for c in COLUMNS)


def _cells(key: str, tool: Tool, flavour: str, name: str) -> tuple[str, ...]:
    version = FMI_VERSION[flavour].partition(".")[0]
    if version not in tool.versions:
        return (f"{_TITLES[key][0]} takes FMI {' and '.join(tool.versions)} only",) * len(COLUMNS)
    part = _part_of(name)
    loop = next(loop for loop, (names, _) in runs.COUPLED.items() if part in names)
    state = _state(flavour, name) if key == "fmpy" else _NO_STATE[key]
    reset = _outcome(lambda: _agrees(tool, flavour, (part,), again=True))
    load = _outcome(lambda: _agrees(tool, flavour, (part,)))
    return (
        load,
        _loop(key, flavour, loop),
        state,
        reset,
        _outcome(lambda: _twice(tool, flavour, part)),
    )


def _part_of(name: str) -> str:
    return next(part for part, (fmu, _) in runs.PARTS.items() if fmu == name)


def _agrees(tool: Tool, flavour: str, names: tuple[str, ...], *, again: bool = False) -> None:
    """Fail unless a tool and our master agree on parts without connections."""
    theirs, own = runs.taken(flavour, tool)
    first = runs.ALONE.get(names[0])
    asked = runs.peer_run(theirs, names, (), _STEP_NS, _STEPS, first)
    plain = runs.peer_run(own, names, (), _STEP_NS, _STEPS, first)
    with tempfile.TemporaryDirectory() as folder:
        found = run_peer(tool, PeerRun(**{**vars(asked), "again": again}), Path(folder))
    runs.assert_equal(found, runs.ours(plain))


def _twice(tool: Tool, flavour: str, part: str) -> None:
    """Fail unless two instances, the second one with its own start, run as each alone."""
    theirs, own = runs.taken(flavour, tool)
    fmu, parameters = runs.PARTS[part]
    given = {"a": parameters, "b": {**parameters, **runs.ALONE.get(part, {})}}
    watch = tuple((name, output) for name in given for output in runs.OUTPUTS[part])

    def run(folder: Path) -> PeerRun:
        parts = {name: Part(str(folder / f"{fmu}.fmu"), start) for name, start in given.items()}
        return PeerRun(parts, (), _STEP_NS, _STEPS, watch)

    with tempfile.TemporaryDirectory() as folder:
        found = run_peer(tool, run(theirs), Path(folder))
    runs.assert_equal(found, runs.ours(run(own)))


@cache
def _loop(key: str, flavour: str, loop: str) -> str:
    with tempfile.TemporaryDirectory() as folder:
        return _outcome(
            lambda: runs.test_loop_agrees_with_our_master(Path(folder), TOOLS[key], flavour, loop)
        )


def _state(flavour: str, name: str) -> str:
    """What FMPy's calls find of saving and restoring, as `cosim fmu check --run` reports it."""
    inspection = inspect_fmu(fmu_folder(flavour) / f"{name}.fmu")
    found = {each.code: each.what for each in run_findings(inspection, 120.0)}
    if "serialize the state" not in found.get("run-done", ""):
        return "; ".join(what for code, what in found.items() if code != "run-log")
    wrong = [found[code] for code in ("run-state", "run-serialized") if code in found]
    return "; ".join(wrong) or "yes"


def _c_host(name: str) -> str:
    path = fmu_folder("native") / f"{name}.fmu"
    with tempfile.TemporaryDirectory() as folder:
        return _outcome(
            lambda: test_c_host.test_c_host_runs_saves_restores(path.parent, Path(folder), name)
        )


def _arm_host(name: str) -> str:
    path = fmu_folder("native")
    with tempfile.TemporaryDirectory() as folder:
        return _outcome(
            lambda: test_c_host.test_c_host_on_another_machine(path, Path(folder), name)
        )


def _outcome(run: Callable[[], None]) -> str:
    """Return yes, or why not: the last line that is said, or why it was skipped."""
    try:
        run()
    except pytest.skip.Exception as skipped:
        return f"not tried: {skipped.msg}"
    except (AssertionError, OSError, ValueError) as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        last = lines[-1].removeprefix("NotImplementedError: ") if lines else type(error).__name__
        return last[:200]
    return "yes"


def page() -> str:
    """Return the page of Markdown."""
    reasons: dict[str, int] = {}
    lines = ["| tool | version | flavour | FMU | " + " | ".join(COLUMNS) + " |"]
    lines.append("|---" * (4 + len(COLUMNS)) + "|")
    tried = set()

    def line(head: Iterable[str], cells: Iterable[str]) -> str:
        short = (
            cell if cell == "yes" else f"– ({reasons.setdefault(cell, len(reasons) + 1)})"
            for cell in cells
        )
        return "| " + " | ".join((*head, *short)) + " |"

    for row in rows():
        tried.add(row.tool)
        lines.append(line(row[:4], row.cells))
    lines += ["", _ARCHIVES_HEAD, "| tool | version | " + " | ".join(ARCHIVES) + " |"]
    lines += ["|---" * (2 + len(ARCHIVES)) + "|"]
    lines += [line(row[:2], row[2:]) for row in archive_rows()]
    missing = {title: "it is not installed" for title, _ in _TITLES.values()} | NOT_TRIED
    if "C program on aarch64" not in tried:
        missing["aarch64 binaries"] = "qemu-user is not at hand where this page was made"
    notes = [f"{number}. {reason}" for reason, number in reasons.items()]
    others = [f"| {tool} | {why} |" for tool, why in missing.items() if tool not in tried]
    return "\n".join(
        [
            _HEAD,
            *lines,
            "",
            *notes,
            "",
            _SYSTEMS,
            _OF_OTHERS,
            "## Not tried",
            "",
            "| tool | why |",
            "|---|---|",
            *others,
            "",
        ]
    )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as session:
        share_below(Path(session))
        Path(sys.argv[1]).write_text(page(), "utf-8")
