"""The troubles: what happens to a command, drawn at random."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from random import Random
from types import MappingProxyType
from typing import Any, NamedTuple

import psutil
from chaos.command import Command
from chaos.doors import DOORS, Fault, end_of
from hostile.expected import RUN_CALLS
from hostile.hostile_fmu import FAULTS

_NOT_FINDABLE = frozenset({"nothing", "flood-stderr", "sleep", "kill-worker"})
"""What is no fault, or one of studies; a sleep in every call makes a run half an hour long."""


class Draw(NamedTuple):
    """What a trouble is drawn from.

    Attributes
    ----------
    usual_s : how long the command takes undisturbed.
    """

    random: Random
    door: str
    usual_s: float

    def instant(self) -> float:
        """Any instant of the command, its beginning more often than the rest."""
        whole = 1.05 * self.usual_s
        return self.random.uniform(0.0, whole if self.random.random() < 0.6 else min(2.0, whole))


@dataclass
class Trouble:
    """What happens to one command.

    Attributes
    ----------
    words : for people.
    fault : of the FMU in it.
    before : called in its process before it begins.
    popen : how it is started.
    during : called when it has begun.
    codes : exit codes beside those of every command and the one that is usual.
    signal : the signal that the command has to answer; 0: none.
    """

    words: str
    fault: Fault | None = None
    before: Callable[[], None] | None = None
    popen: dict[str, Any] = field(default_factory=dict)
    during: Callable[[Command], None] = lambda _: None
    codes: frozenset[int] = frozenset()
    signal: int = 0


def interrupted(draw: Draw) -> Trouble:
    """Ctrl-C or SIGTERM at any instant, to the process alone or to its group."""
    number = draw.random.choice([signal.SIGINT, signal.SIGINT, signal.SIGTERM])
    group, at = draw.random.random() < 0.5, draw.instant()
    to = "its group" if group else "it"
    found = _at(at, lambda command: command.send(number, group=group))
    return Trouble(
        f"{number.name} to {to} at {at:.3f} s",
        during=found,
        codes=frozenset({128 + number, -number}),
        signal=number,
    )


def interrupted_twice(draw: Draw) -> Trouble:
    """A second Ctrl-C soon after the first."""
    group, at, then = draw.random.random() < 0.5, draw.instant(), draw.random.uniform(0.0, 0.3)

    def during(command: Command) -> None:
        command.send(signal.SIGINT, group=group)
        time.sleep(then)
        command.send(signal.SIGINT, group=group)

    to = "its group" if group else "it"
    words = f"SIGINT to {to} at {at:.3f} s and {then:.3f} s later"
    return Trouble(words, during=_at(at, during), codes=frozenset({130, -2}), signal=signal.SIGINT)


def killed(draw: Draw) -> Trouble:
    """SIGKILL: what it has flushed stays, and the next one tidies up."""
    at = draw.instant()
    kill = _at(at, lambda command: command.send(signal.SIGKILL, group=False))
    codes = frozenset({-signal.SIGKILL})
    return Trouble(f"SIGKILL at {at:.3f} s", during=kill, codes=codes, signal=signal.SIGKILL)


def child_killed(draw: Draw) -> Trouble:
    """A process that it has started is killed."""
    at, which = draw.instant(), draw.random.random()
    number = draw.random.choice([signal.SIGKILL, signal.SIGSEGV, signal.SIGTERM])

    def during(command: Command) -> None:
        children = command.children()
        if children:
            with suppress(psutil.Error):
                children[int(which * len(children))].send_signal(number)

    return Trouble(f"{number.name} to a child at {at:.3f} s", during=_at(at, during))


def stopped(draw: Draw) -> Trouble:
    """All its processes stand still for a while, as with Ctrl-Z and fg."""
    at, lasting = draw.instant(), draw.random.uniform(0.1, 1.0)

    def during(command: Command) -> None:
        command.send(signal.SIGSTOP, group=True)
        time.sleep(lasting)
        command.send(signal.SIGCONT, group=True)

    return Trouble(f"stopped at {at:.3f} s for {lasting:.1f} s", during=_at(at, during))


def file_size(draw: Draw) -> Trouble:
    """No file may be larger than so much: a disk that is full, as far as a program sees it."""
    most = int(10 ** draw.random.uniform(0.0, 6.5))
    return Trouble(
        f"no file larger than {most} bytes",
        before=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (most, most)),
    )


def descriptors(draw: Draw) -> Trouble:
    """So many open files and no more."""
    most = draw.random.randint(6, 48)
    return Trouble(
        f"no more than {most} open files",
        before=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (most, most)),
    )


def closed_streams(draw: Draw) -> Trouble:
    """Some of the standard streams are closed from the start."""
    which = draw.random.sample([0, 1, 2], draw.random.randint(1, 3))

    def before() -> None:
        for number in which:
            os.close(number)

    return Trouble(f"descriptors {sorted(which)} closed", before=before)


def reader_gone(_draw: Draw) -> Trouble:
    """Nobody reads its output any more."""
    reads, writes = os.pipe()
    os.close(reads)
    return Trouble(
        "its standard output has no reader",
        popen={"stdout": writes},
        codes=frozenset({-signal.SIGPIPE}),
    )


def inherited(draw: Draw) -> Trouble:
    """Descriptors that nobody has asked for, some with bytes in them."""
    count = draw.random.randint(1, 40)

    def before() -> None:
        for _ in range(count):
            reads, writes = os.pipe()
            os.set_inheritable(reads, True)  # noqa: FBT003 - its only argument
            os.set_inheritable(writes, True)  # noqa: FBT003
            os.write(writes, b"\x00\x00\x00\x01x")

    return Trouble(f"{count} pipes inherited", before=before, popen={"close_fds": False})


def place_gone(draw: Draw) -> Trouble:
    """What it is writing, its folder or its temporary folder, is taken away."""
    at = draw.instant()
    what = draw.random.choice(["its partial files", "its temporary folder", "its folder"])

    def during(command: Command) -> None:
        if what == "its folder":
            with suppress(OSError):
                command.folder.rename(command.folder.with_name("moved"))
            return
        partial = what == "its partial files"
        among = command.folder.rglob("*.partial*") if partial else command.scratch.iterdir()
        for path in list(among):
            with suppress(OSError):
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    return Trouble(f"{what} gone at {at:.3f} s", during=_at(at, during))


def two_at_once(draw: Draw) -> Trouble:
    """The same command a second time, in the same folder, a little later."""
    later = draw.instant()
    return Trouble(f"the same again {later:.3f} s later", during=_at(later, Command.start_again))


def hostile(draw: Draw) -> Trouble:
    """An FMU that misbehaves, in some call at some time."""
    fault = draw.random.choice([name for name in FAULTS if name not in _NOT_FINDABLE])
    call, version = draw.random.choice(RUN_CALLS), draw.random.choice(["2.0", "3.0"])
    at = draw.random.choice([0.0, round(draw.random.uniform(0.0, end_of(draw.door)), 2)])
    words = f"FMI {version}: {fault} in {call} at t = {at:g} s"
    return Trouble(words, fault=Fault(fault, call, at, version))


TROUBLES: Mapping[str, Callable[[Draw], Trouble]] = MappingProxyType(
    {
        each.__name__: each
        for each in (
            *(interrupted, interrupted_twice, killed, child_killed, stopped, file_size),
            *(descriptors, closed_streams, reader_gone, inherited, place_gone, two_at_once),
            hostile,
        )
    }
)


def doors_of(trouble: str) -> list[str]:
    """The doors that a trouble can come to."""
    if trouble == "hostile":
        return [name for name, door in DOORS.items() if door.runs_fmus]
    own = "session" if trouble == "reader_gone" else ""  # what prints there is no part of it
    return [name for name in DOORS if name != own]


def _at(seconds: float, do: Callable[[Command], None]) -> Callable[[Command], None]:
    def during(command: Command) -> None:
        with suppress(subprocess.TimeoutExpired):
            command.process.wait(seconds)
        if command.lives:
            do(command)

    return during
