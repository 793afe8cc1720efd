"""One trial: a command, a trouble, and whether it ended as commands must."""

from __future__ import annotations

import re
import shutil
import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import NamedTuple

from chaos.command import Command, Ended
from chaos.doors import DOORS, lay_out
from chaos.troubles import TROUBLES, Draw, Trouble, doors_of

from cosim.core import CosimError
from cosim.trace import Trace, recover, verify

CODES = frozenset({0, 1, 2, 3, 4, 5, 6, 130, 141, 143})
"""Exit codes that the pages name."""
INTERRUPTIONS = ("interrupted", "interrupted_twice")
_FAILED = 4
_MAKE_COMPONENTS_FAIL = ("hostile", "child_killed", "place_gone")
_MOST_SECONDS = 20.0
"""Until the end after Ctrl-C, on a busy machine."""
_NEVER = re.compile(
    r"Traceback \(most|[Uu]nexpected|Exception ignored|Fatal Python|core dumped|Aborted"
)
_OURS = re.compile(r"cosim/cli/(entry|interruptions|application)\.py|cosim: |interrupted")


class Trial(NamedTuple):
    """What is tried.

    Attributes
    ----------
    seed, number : they decide all the rest.
    """

    seed: int
    number: int
    trouble: str
    door: str


class Found(NamedTuple):
    """What a trial has shown.

    Attributes
    ----------
    words : of the trouble.
    departures : what is not as it must be.
    """

    trial: Trial
    words: str
    ended: Ended
    departures: tuple[str, ...]


def trial_of(seed: int, number: int, troubles: tuple[str, ...] = ()) -> Trial:
    """The trial of a number: every second one is an interruption, the others are drawn.

    troubles : to draw from; none named: all.
    """
    random = Random(f"{seed} {number}")  # noqa: S311 - no secret
    others = [*(troubles or (name for name in TROUBLES if name not in INTERRUPTIONS))]
    interrupts = not troubles and number % 2 == 0
    trouble = random.choice(INTERRUPTIONS if interrupts else others)
    return Trial(seed, number, trouble, random.choice(doors_of(trouble)))


def attempt(trial: Trial, stock: Path, run_s: float) -> Found:
    """Make a trial.

    stock : what the doors read.
    run_s : how long a run takes undisturbed.
    """
    usual_s = run_s * DOORS[trial.door].takes
    random = Random(f"{trial.seed} {trial.number} {trial.trouble} {trial.door}")  # noqa: S311
    trouble = TROUBLES[trial.trouble](Draw(random, trial.door, usual_s))
    place = Path(tempfile.mkdtemp(prefix="chaos-"))
    try:
        folder, scratch = place / "work", place / "tmp"
        folder.mkdir()
        line = lay_out(trial.door, stock, folder, trouble.fault)
        command = Command(line, folder, scratch, trouble.before, **trouble.popen)
        trouble.during(command)
        ended = command.ended()
        over = command.was_over is not False  # also one that ended before the trouble came
        wrong = [*_departures(trial, trouble, ended, over=over), *_wrong_traces(place)]
        at_once = ended.code in (-signal.SIGKILL, -signal.SIGTERM, -signal.SIGINT)
        if trouble.signal and at_once and folder.is_dir():
            wrong += _wrong_after_kill(trial, line, folder, ended.files_left, stock)
        elif ended.files_left:
            wrong.append(f"left in the temporary folder: {', '.join(ended.files_left)}")
        return Found(trial, trouble.words, ended, tuple(wrong))
    finally:
        shutil.rmtree(place, ignore_errors=True)


def _departures(trial: Trial, trouble: Trouble, ended: Ended, *, over: bool) -> Iterator[str]:
    """What is not as it must be of the end of a command.

    over : it had printed its result before the trouble came, which then changes nothing.
    """
    if ended.code is None:
        yield "it hangs"
        return
    before_entry = trouble.signal == signal.SIGINT and not _OURS.search(ended.printed)
    if ended.code not in CODES | trouble.codes and not before_entry:
        yield f"exit code {ended.code}"
    if ended.code == _FAILED and trial.trouble not in _MAKE_COMPONENTS_FAIL:
        yield "a component is said to have failed"
    if (never := _NEVER.search(ended.printed)) and not before_entry:
        yield f"printed: {never[0]}"
    if trial.trouble in INTERRUPTIONS and not over:
        if ended.code not in trouble.codes and not before_entry:
            yield f"exit code {ended.code}, {ended.seconds:.1f} s after the signal"
        if ended.seconds > _MOST_SECONDS:
            yield f"{ended.seconds:.0f} s until it ended"
    yield from (f"left: {line}" for line in ended.processes_left)


def _wrong_traces(folder: Path) -> Iterator[str]:
    """Whatever trace there is passes `verify`, or `recover` makes of it one that can be read."""
    for path in sorted(folder.rglob("*.mcap")):
        if not path.parent.name.endswith(".partial"):  # else it was not whole when it was killed
            yield from _wrong_trace(path)
    for path in sorted(folder.rglob("*.mcap.partial*")):
        try:
            target = folder / "mended.mcap"
            recover(path, target, force=True)
            Trace(target)
        except CosimError as error:
            nothing = "nothing in this file can be recovered" in error.text()
            if not nothing and path.stat().st_size:
                yield f"{path.name}: {error.text()}"


def _wrong_trace(path: Path) -> Iterator[str]:
    try:
        verdict = verify(path)
    except CosimError as error:
        yield f"{path.name}: {error.text()}"
        return
    for check in verdict.checks:
        if check.verdict == "failed":
            yield f"{path.name}: {check.name}: {check.detail}"


def _wrong_after_kill(
    trial: Trial, line: list[str], folder: Path, left: tuple[str, ...], stock: Path
) -> Iterator[str]:
    """The next one of the same goes well, keeps what the killed one had, and leaves nothing.

    left : by the killed one in the temporary folder; the next that unpacks FMUs removes it.
    """
    scratch = folder.with_name("tmp")
    kept = [path for path in folder.rglob("*.mcap.partial") if path.stat().st_size]
    again = Command(line, folder, scratch).ended()
    if again.code != DOORS[trial.door].usual:
        yield f"the next one ends with {again.code}: {again.printed[-300:]}"
    still = again.files_left
    if still and {*still} <= {*left}:  # a study may have had nothing to do
        still = Command(lay_out("run", stock, folder), folder, scratch).ended().files_left
    if still:
        yield f"left in the temporary folder by the next one: {', '.join(still)}"
    for path in kept:
        if trial.door.startswith("run") and f"{path.name}.1" not in again.printed:
            rows = _has_rows(path.with_name(f"{path.name}.1"))
            if rows:
                yield f"{path.name}: its rows are not named"


def _has_rows(path: Path) -> bool:
    try:
        return path.exists() and bool(Trace(path).topics)
    except CosimError:
        return False
