"""Both engines give the same rows, log lines and failures, bit for bit."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled import end, ns, section_5
from mixed import mixed_fmu
from shared import fmu_store, sampled

import cosim
from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    EngineName,
    Link,
    Observer,
    Run,
    System,
    make_schedule,
    simulate,
)
from cosim.network import Jitter, PacketLink, TransportLink

PROJECT = Path(cosim.__file__).parents[1]
ENGINES: tuple[EngineName, EngineName] = ("python", "kernel")


class Diary(Observer):
    """Records everything that an observer receives."""

    def __init__(self) -> None:
        self.lines: list[Any] = []

    def begin(self, instances: Sequence[Any]) -> None:
        self._instances = instances

    def rows_complete(self, first: int, last: int) -> None:
        for k in range(first, last):
            values = [
                (s.name, s.outputs[k].tolist(), s.inputs[k].tolist()) for s in self._instances
            ]
            self.lines.append((k, values))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        self.lines.append((time_ns, level, name, message))


def both(make: Callable[[], System]) -> Run:
    """Run on each engine, compare the runs, return one."""
    runs, diaries = [], []
    for engine in ENGINES:
        diary = Diary()
        runs.append(simulate(make(), [diary], engine=engine))
        diaries.append(diary.lines)
        assert runs[-1].engine.name == engine
    one, other = runs
    assert repr(diaries[0]) == repr(diaries[1])
    assert (one.status, one.reason) == (other.status, other.reason)
    assert one.points_ns.tolist() == other.points_ns.tolist()
    count = one.points_ns.size
    for a, b in zip(one.instances, other.instances, strict=True):
        assert a.outputs[:count].tobytes() == b.outputs[:count].tobytes()
        assert a.inputs[:count].tobytes() == b.inputs[:count].tobytes()
    return one


LINKS: dict[str, list[Link]] = {
    "wires": [],
    "packets": [
        PacketLink(
            "sc", ns(0.1), 0, ns(0.033), jitter=Jitter("uniform", width_ns=ns(0.05)), loss=0.2
        ),
        PacketLink("ca", ns(0.07), ns(0.01), ns(0.02)),
    ],
    "as arrived": [
        PacketLink(
            "sc",
            ns(0.05),
            0,
            ns(0.01),
            jitter=Jitter("exponential", mean_ns=ns(0.1)),
            order="as-arrived",
        )
    ],
    "quantized and replaced": [
        PacketLink("sc", ns(0.1), delay_ns=ns(0.033), quantization=1e-3, loss=0.3, on_loss=0.1),
        PacketLink("ca", ns(0.1), loss=0.3, on_loss="zero"),
    ],
    "transport": [TransportLink("sc", ns(0.0333)), TransportLink("ca", ns(0.2))],
}


@pytest.mark.parametrize("links", LINKS.values(), ids=LINKS)
@pytest.mark.parametrize("events", sampled(["align", "grid"], 1))
def test_engines_agree_bit_for_bit(fmus: Path, links: list[Link], events: Any) -> None:
    run = both(lambda: section_5(fmus, step=0.01, stop=3.0, links=links, events=events))
    assert run.status == "finished"


def test_engines_agree_on_divergence(fmus: Path) -> None:
    run = both(lambda: section_5(fmus, step=0.05, stop=9.0, plant={"A[1,1]": 30.0}, divergence=1e3))
    assert run.status == "diverged"


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return mixed_fmu(tmp_path_factory.mktemp("mixed"))


def ring(
    fmu: Path, *, links: Sequence[Link] = (), stop: float = 2.0, **parameters: float
) -> System:
    """A slave that feeds another one back its Integer and Boolean, and gets its Real."""
    named = {link.name: link for link in links}
    way = next(iter(named), None)
    described = describe_fmu(fmu)
    comm_schedule = make_schedule(named, ns(0.1), ns(stop), "align")
    pairs = [("a.y", "b.u", None), ("a.n", "b.j", way), ("a.f", "b.c", way), ("b.f", "a.c", None)]
    return System(
        {"a": Component(described, parameters), "b": Component(described, {"u": 0.5})},
        [Connection(end(s), end(t), link) for s, t, link in pairs],
        named,
        {end("a.u"): np.sin(comm_schedule.points_ns / 1e9)},
        comm_schedule,
        1e6,
    )


def test_values_of_every_type_are_exchanged(mixed: Path) -> None:
    run = both(lambda: ring(mixed, links=[PacketLink("l", ns(0.2), delay_ns=ns(0.1))]))
    steps = np.arange(run.points_ns.size)
    assert run.signal("a", "n").tolist() == steps.tolist()
    assert run.signal("b", "u").tolist() == (2.0 * np.sin(run.points_ns / 1e9)).tolist()
    # a message each 0.2 s, 0.1 s on its way: seen first at point 1, then every second point
    assert run.signal("b", "j").tolist() == [0, *(2 * ((k - 1) // 2) for k in steps[1:].tolist())]
    assert run.signal("a", "f")[1:].tolist() == (1.0 - run.signal("a", "c")[:-1]).tolist()
    assert set(run.signal("a", "c").tolist()) == {0.0, 1.0}


@pytest.mark.parametrize(
    ("status", "word"), [(2, "fmi2Discard"), (3, "fmi2Error"), (4, "fmi2Fatal")]
)
@pytest.mark.parametrize("reading", [False, True])
def test_failure_names_component_time_and_message(
    mixed: Path, status: int, word: str, *, reading: bool
) -> None:
    run = both(lambda: ring(mixed, fail_at=0.75, status=status, fail_get=reading))
    assert run.status == "failed"
    assert run.reason is not None
    assert "'a'" in run.reason
    assert "0.8 s" in run.reason
    assert ("cannot be read any more" if reading else "it broke") in run.reason
    assert word in run.reason
    # a row that was broken off does not count; one that was complete before the step does
    assert run.points_ns.size == (8 if reading else 9)
    assert run.signal("a", "y").size == run.points_ns.size


def test_others_are_ended_after_a_failure_but_not_after_a_fatal_one(mixed: Path) -> None:
    """FMI 2.0: after fmi2Error of one slave the others may go on; after fmi2Fatal none may."""
    for status, terminated in ((3, ["b"]), (4, [])):
        diary = Diary()
        simulate(ring(mixed, fail_at=0.5, status=status), [diary])
        ended = [line[2] for line in diary.lines if line[-1] == "terminated"]
        assert ended == terminated


def test_log_lines_are_delivered_between_the_rows_they_were_logged_between(mixed: Path) -> None:
    diary = Diary()
    simulate(ring(mixed), [diary])
    place = [i for i, line in enumerate(diary.lines) if line[-1] == "four more"]
    # said in the step from point 3: after row 3, before row 4, by both
    assert [diary.lines[i][2] for i in place[:2]] == ["a", "b"]
    assert diary.lines[place[0]][0] == ns(0.3)
    assert diary.lines[place[0] - 1][0] == 3
    assert diary.lines[place[1] + 1][0] == 4


def test_log_level_filters_the_log_of_a_component(mixed: Path) -> None:
    terminated = {}
    for level in ("debug", "warning"):
        system = ring(mixed)
        quiet = {n: replace(c, log_level=level) for n, c in system.components.items()}
        diary = Diary()
        simulate(replace(system, components=quiet), [diary])
        terminated[level] = [line for line in diary.lines if len(line) == 4 and line[2] in quiet]
    assert any(line[-1] == "four more" for line in terminated["debug"])
    assert terminated["warning"] == [line for line in terminated["debug"] if line[1] == "warning"]


def test_engine_choice_gives_its_reason(mixed: Path) -> None:
    """That of events and of texts is beside the runs that have them."""
    chosen = {engine: simulate(ring(mixed), engine=engine).engine for engine in (*ENGINES, "auto")}
    assert chosen == {
        "python": ("python", "asked for"),
        "kernel": ("kernel", "asked for"),
        "auto": ("kernel", "numbers only"),
    }


def test_without_a_compiler_the_loop_is_in_python(tmp_path: Path) -> None:
    """Which the result says, with the reason; the kernel alone is refused, with a way out."""
    line = ("run", "paper-example", "--until", "0.1", "--flavour", "python", "--json")
    line = (sys.executable, "-m", "cosim", *line, "--fmus", str(fmu_store("python")))
    found = {}
    for engine in ("auto", "kernel"):
        done = subprocess.run(  # noqa: S603 - ourselves
            [*line, "--engine", engine],
            cwd=tmp_path,
            env={**os.environ, "CC": "no-such-compiler", "PYTHONPATH": str(PROJECT)},
            capture_output=True,
            text=True,
            check=False,
        )
        found[engine] = json.loads(done.stdout)
    assert found["auto"]["engine"]["name"] == "python"
    assert "CC=no-such-compiler" in found["auto"]["engine"]["reason"]
    assert "or take the engine python" in found["kernel"]["error"]["hint"]


def test_two_hundred_thousand_steps_agree(mixed: Path) -> None:
    """More than one segment on either engine."""
    run = simulate(ring(mixed, stop=20_000.0), engine="kernel")
    assert run.points_ns.size == 200_001
    assert run.signal("a", "n")[-1] == 200_000
    assert math.isclose(run.signal("b", "u")[-1], 2.0 * math.sin(20_000.0))
