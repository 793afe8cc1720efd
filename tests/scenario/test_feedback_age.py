"""What settings say of the age of the feedback holds in runs, and proofs are held against both."""

from __future__ import annotations

import io
import random
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from master.scalar import end, ns, scalar_fmu
from random_runs import RandomRuns
from rich.console import Console

from cosim.cli.run_view import outcome_view
from cosim.core import InputError, NotAchievableError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.hinf import auv_system
from cosim.master import Component, Connection, Link, Session, System, make_schedule
from cosim.network import (
    DelayProfile,
    GilbertElliott,
    Hop,
    Jitter,
    LossWindow,
    Medium,
    Node,
    PacketLink,
    Recording,
    TransportLink,
)
from cosim.scenario import FmuCache, Problem, execute_run, load, prepare, problem_of
from cosim.scenario.age import MeasuredAges, measured_ages
from cosim.scenario.feedback_age import FeedbackAge, feedback_age
from cosim.scenario.gain import solve, with_known_age
from cosim.scenario.guarantee.ages import FedBack, feedback_findings
from cosim.scenario.measure import measured
from cosim.scenario.schema import DesignPart
from cosim.trace import assumptions_of, describe, render

STEP = ns(0.05)
UP = [("plant.eta.x", "controller.eta.x"), ("plant.nu.u", "controller.nu.u")]
DOWN = [("controller.force.x", "plant.force.x")]


@pytest.fixture(scope="module")
def fmus(native_fmus: Path) -> Mapping[str, FmuDescription]:
    return {
        "plant": describe_fmu(native_fmus / "AuvPlant.fmu"),
        "controller": describe_fmu(native_fmus / "HinfController.fmu"),
    }


def system_of(
    fmus: Mapping[str, FmuDescription],
    up: Link | None,
    down: Link | None,
    *,
    events: Any = "align",
    sample_time: float = 0.05,
    **more: Any,
) -> System:
    """The vehicle and its controller, with a link or a wire each way."""
    links = {link.name: link for link in (up, down) if link is not None}
    wires = [
        Connection(end(a), end(b), None if link is None else link.name)
        for pairs, link in ((UP, up), (DOWN, down))
        for a, b in pairs
    ]
    components = {
        "plant": Component(fmus["plant"]),
        "controller": Component(fmus["controller"], {"sample_time": sample_time}),
    }
    schedule = make_schedule(links, STEP, 160 * STEP, events)
    return System(components, wires, links, {}, schedule, **more)


def ages_of(system: System) -> MeasuredAges | None:
    """The ages that a run of it has."""
    with Session(system, engine="python") as session:
        session.run_until(None)
        return measured(session.result(), measured_ages("plant", "controller", system.algorithm))


def known_of(system: System) -> FeedbackAge:
    found = feedback_age(system, "plant", "controller")
    assert found is not None
    return found


def check(system: System) -> FeedbackAge:
    """What is known of the ages holds in the run."""
    known, found = known_of(system), ages_of(system)
    if found is None or found.least_ns is None:
        return known
    assert found.least_ns >= known.least_ns
    if known.greatest_ns is not None:
        assert found.greatest_ns <= known.greatest_ns
    if known.sampled:
        assert found.in_use_ns == (known.least_ns, known.least_ns)
        assert found.alike
        if known.greatest_ns is not None and found.first_ns < 80 * STEP:
            assert found.greatest_ns == known.greatest_ns
    return known


def random_link(r: random.Random, name: str) -> Link | None:
    """A wire or a link, mostly on the grid of the step."""
    kind = r.random()
    if kind < 0.15:
        return None
    if kind < 0.3:
        return TransportLink(name, int(r.choice([0, 1, 5, 2.5]) * STEP))
    every = r.choice([1, 2, 3, 4, 6]) * STEP
    given: dict[str, Any] = {"offset_ns": r.choice([0, 0, 1, 2, 5]) * STEP, "seed": r.randint(0, 9)}
    delay = r.choice([0, 1, 2, 5])
    if r.random() < 0.6:
        given["loss"] = r.choice([0.0, 0.2, 0.5, GilbertElliott(0.2, 0.5)])
    if r.random() < 0.6:
        given["playout_ns"] = int((delay + r.choice([1, 2, 3.5])) * STEP)
        given["jitter"] = Jitter("uniform", width_ns=r.choice([1, 2, 4]) * STEP)
        given["order"] = r.choice(["newest-wins", "fifo", "as-arrived"])
        given["duplicate"] = r.choice([0.0, 0.3])
    elif r.random() < 0.2:
        given["jitter"] = Jitter("uniform", width_ns=STEP)
    return PacketLink(name, every, delay_ns=delay * STEP, **given)


def test_what_settings_say_of_the_age_holds_in_random_runs(
    fmus: Mapping[str, FmuDescription],
) -> None:
    """Least, greatest and sampled ages, over two links of any kind."""
    seen = []
    for seed in range(60):
        r = random.Random(seed)  # noqa: S311 - cases, not secrets
        up, down = random_link(r, "up"), random_link(r, "down")
        events, sample = r.choice(["align", "grid"]), r.choice([0.0, 0.05, 0.05, 0.1, 0.15])
        system = system_of(fmus, up, down, events=events, sample_time=sample)
        seen.append(check(system).sampled)
    assert 15 < sum(seen) < 45


def test_what_a_recording_says_of_the_age_holds(fmus: Mapping[str, FmuDescription]) -> None:
    """Its least and greatest delay, and its losses, with and without a play-out."""
    random = np.random.default_rng(2)
    greatest = []
    for k in range(12):
        every = int(random.choice([2, 3])) * STEP
        lost = random.random(7) < (0.3 if k % 3 == 0 else 0.0)
        delays = random.integers(1, 6, 7) * (STEP if k % 2 else STEP // 3)
        recording = Recording(np.arange(7) * every, lost, delays, "loop")
        playout = int(random.choice([0, 0, 4 * STEP, 8 * STEP]))
        playout = max(playout, recording.least_ns) if playout else 0
        up = PacketLink("up", every, playout_ns=playout, recording=recording)
        known = check(system_of(fmus, up, None))
        assert known.least_ns >= recording.least_ns
        greatest.append(known.greatest_ns)
    assert 3 < sum(each is not None for each in greatest) < 12


def test_no_age_of_a_random_system_is_below_the_least(
    native_fmus: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Steps of their own, policies that look ahead, live delays: an age is an interval at least."""
    folder = tmp_path_factory.mktemp("scalar")
    runs = RandomRuns(native_fmus, scalar_fmu(folder), scalar_fmu(folder, declared=False))
    checked = 0
    for seed in [136, *range(40)]:  # 136: a transport link read half a step ahead
        made = runs.run(seed)
        if made is None or not made[1].points_ns.size:
            continue
        system, run = made
        known = feedback_age(system, "plant", "controller")
        found = measured(run, measured_ages("plant", "controller", system.algorithm))
        if known is None or found is None or found.least_ns is None:
            continue
        assert found.least_ns >= known.least_ns, seed
        assert known.greatest_ns is None or found.greatest_ns <= known.greatest_ns, seed
        checked += 1
    assert checked > 10


FIXES = PacketLink(
    "up", 3 * STEP, delay_ns=4 * STEP, jitter=Jitter("uniform", width_ns=3 * STEP), loss=0.3
)
BUFFERED = replace(FIXES, playout_ns=7 * STEP)
BAY = Medium("bay", (Node("a", (0.0,)), Node("b", (1.0,))), 1000)
ON_MEDIUM = PacketLink("up", 3 * STEP, frame_size=10, hop=Hop(BAY, "a", "b"))


@pytest.mark.parametrize(
    ("up", "down", "words"),
    [
        (FIXES, None, "with jitter, and without playout"),
        (replace(BUFFERED, playout_ns=7 * STEP + 1), None, "off the grid"),
        (BUFFERED, replace(BUFFERED, name="down"), "in a later message"),
        (BUFFERED, replace(BUFFERED, name="down", sample_time_ns=6 * STEP), "an older measurement"),
        (BUFFERED, replace(BUFFERED, name="down", sample_time_ns=4 * STEP), "does not go with"),
        (TransportLink("up", STEP // 2), None, "no multiple of the step"),
        (
            PacketLink("up", STEP, delay=DelayProfile((0, STEP), (STEP, 2 * STEP))),
            None,
            "its delay varies",
        ),
        (PacketLink("up", STEP, data_rate=10, frame_size=10), None, "wait in a queue"),
        (PacketLink("up", STEP, recording=Recording([0], [0], [1], "loop")), None, "delay varies"),
        (ON_MEDIUM, None, "shares a medium with others"),
    ],
)
def test_why_an_age_is_not_sampled(
    fmus: Mapping[str, FmuDescription], up: Link, down: Link | None, words: str
) -> None:
    """The sentence names what prevents it."""
    known = known_of(system_of(fmus, up, down))
    assert not known.sampled
    assert words in known.why


def test_over_a_medium_any_message_may_be_lost_and_none_is_younger_than_its_airtime(
    fmus: Mapping[str, FmuDescription],
) -> None:
    """Another link may collide with it at any time: there is no greatest age, but a least one."""
    known = known_of(system_of(fmus, ON_MEDIUM, None))
    assert known.greatest_ns is None
    assert known.least_ns >= ON_MEDIUM.frame_ns
    buffered = known_of(system_of(fmus, replace(ON_MEDIUM, playout_ns=STEP), None))
    assert buffered.sampled
    assert buffered.greatest_ns is None


def test_losses_on_both_ways_are_sampled_only_one_at_a_time(
    fmus: Mapping[str, FmuDescription],
) -> None:
    """A command that is lost brings its measurement back later, unless a newer one came."""
    sure = replace(BUFFERED, loss=0.0)
    for up, down, sampled in (
        (BUFFERED, replace(sure, name="down"), True),
        (sure, replace(BUFFERED, name="down"), True),
        (BUFFERED, replace(BUFFERED, name="down"), False),
        (BUFFERED, replace(sure, name="down", windows=(LossWindow(0, STEP, 1.0),)), False),
    ):
        assert check(system_of(fmus, up, down)).sampled == sampled
    late = replace(sure, jitter=Jitter("uniform", width_ns=6 * STEP))
    assert known_of(system_of(fmus, late, None)).greatest_ns is None
    assert known_of(system_of(fmus, sure, None)).greatest_ns == 7 * STEP + STEP + 3 * STEP


SAMPLED = FedBack("x", 1.25, 0.35, "sampled: from least_age at rate one to d at most")
JUST = FeedbackAge(ns(0.35), None, sampled=True, why="")
RIGHT = MeasuredAges(ns(0.35), ns(0.95), (ns(0.35), ns(0.35)), ns(0.35), alike=True)


@pytest.mark.parametrize(
    ("changed", "wrong"),
    [
        ({}, set()),
        ({"greatest_ns": ns(1.25)}, set()),
        ({"greatest_ns": ns(1.25) + 1}, {"message_age_within_design"}),
        ({"least_ns": ns(0.35) - 1}, {"message_age_not_below_least"}),
        ({"least_ns": None}, {"message_age_not_below_least"}),
        ({"first_ns": ns(1.25) + 1}, {"message_age_within_design"}),
        ({"interrupted": True}, {"message_age_within_design"}),
        ({"in_use_ns": (ns(0.35), ns(0.35) + 1)}, {"message_age_sampled"}),
        ({"alike": False}, {"message_age_sampled", "measurements_equally_old"}),
    ],
)
def test_each_fault_of_an_age_fails_its_own_assumption(
    changed: dict[str, Any], wrong: set[str]
) -> None:
    """Too old, below the least age, late at first, interrupted, another age in use: by 1 ns."""
    found = feedback_findings(SAMPLED, RIGHT._replace(**changed), "", substituted=False)
    assert {name for name, departures in found.items() if departures} == wrong


@pytest.mark.parametrize(
    "word", ["constant, exactly d", "constant, up to d", "constant, from 1/2 to d", "unheard of"]
)
def test_no_proof_of_a_constant_age_covers_a_run(word: str) -> None:
    """However little it varies: the proof is about another loop, and the run says what proves it.

    A word that has no rule covers nothing.
    """
    found = feedback_findings(
        FedBack("x", 1.0, 0.0, word), RIGHT, "prove it again", substituted=False
    )
    (departure,) = found["message_age_constant"]
    assert "prove it again" in departure.got


def printed(view: Any) -> str:
    """What a terminal shows, in one line."""
    console = Console(width=300, file=io.StringIO())
    console.print(view)
    return " ".join(console.file.getvalue().split())  # type: ignore[attr-defined]


def test_playout_scenario_keeps_to_its_proof(native_fmus: Path, tmp_path: Path) -> None:
    """The built-in scenario, its gamma below that of the link without a buffer, and without it."""
    results = {}
    for playout in ("0.3", "0"):
        loaded = load("auv-acoustic-playout", (f"links.fixes.playout={playout}", "run.end=40"))
        cache = FmuCache(native_fmus.parent, loaded.folder, flavour="native")
        results[playout] = execute_run(prepare(loaded, cache), tmp_path / f"{playout}.mcap")
    kept = results["0.3"]
    assert all(kept.metrics["assumptions"].values())
    assert kept.metrics["gamma"] < 2.05
    assert kept.links["fixes"]["late"] > 0
    age = kept.metrics["feedback_age"]
    assert age["assumed"].startswith("sampled: exactly 0.35 s")
    assert age["measured"]["in_use_s"] == [0.35, 0.35]
    assert age["settings"]["sampled"] is True
    failed = {k for k, met in results["0"].metrics["assumptions"].items() if not met}
    assert failed == {"message_age_sampled", "message_age_not_below_least"}
    assert "without playout" in results["0"].metrics["feedback_age"]["settings"]["why"]
    for playout, words in (("0.3", "always 0.35 s when"), ("0", "0.3 s to 0.4 s when")):
        info = describe(tmp_path / f"{playout}.mcap")
        for text in (printed(outcome_view(results[playout])), printed(render(info))):
            assert "sampled: exactly 0.35 s when a measurement comes into use" in text
            assert words in text
        checks = {check.what: check for check in assumptions_of(results[playout])}
        used = checks["Every measurement came into use at the age of the proof"]
        assert words in used.why if playout == "0.3" else "0.35 s old when" in used.why
    assert "dropped late mean delay" in printed(outcome_view(kept))


def test_design_takes_the_keys_of_ages(tmp_path: Path) -> None:
    """As in the file of a system; a rate, or an age of immediate feedback, is refused."""
    part = DesignPart(system="auv", loop_delay=1.25, least_age=0.35, sampled=True)
    late = problem_of(part, tmp_path).system.delays[1]
    assert (late.d, late.least_age, late.sampled) == (1.25, 0.35, True)
    for given, where in (
        ({"system": "paper", "sampled": True}, "design.sampled"),
        ({"system": "auv", "loop_delay": 1.0, "least_age": 1.0}, "design.least_age"),
    ):
        with pytest.raises(InputError) as caught:
            problem_of(DesignPart(**given), tmp_path)
        assert caught.value.where == where


NETWORKED = """
[system]
A = [[0.0, 1.0], [0.0, -0.1]]
B = [[0.0], [0.1]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [0.1]]
[[system.delays]]
d = 0.6
feedback = true
any_age = true
"""


def test_a_design_for_a_bounded_rate_flies_over_no_link(tmp_path: Path) -> None:
    """Values are held: their age grows at rate one and falls."""
    (tmp_path / "networked.toml").write_text(NETWORKED, "utf-8")
    part = DesignPart(system="networked.toml", rate=0.5, gain=[[-3.75, -11.5]])
    with pytest.raises(NotAchievableError, match="no bounded rate"):
        solve(problem_of(part, tmp_path), part.gain)


def test_links_sharpen_a_problem_that_says_any_age() -> None:
    """Sampled or from the least age on; not below zero, beyond the bound, or what is known."""
    system = auv_system()
    problem = Problem(system, None, None, None)

    def feedback(known: FeedbackAge | None) -> tuple[float, bool]:
        late = with_known_age(problem, known).system.delays[1]
        return late.least_age, late.sampled

    assert feedback(JUST) == (0.35, True)
    assert feedback(replace(JUST, sampled=False)) == (0.35, False)
    assert feedback(replace(JUST, least_ns=ns(1.25))) == (0.0, False)
    assert feedback(replace(JUST, least_ns=0)) == (0.0, False)
    assert feedback(None) == (0.0, False)
    known = with_known_age(problem, JUST)
    assert with_known_age(known, replace(JUST, least_ns=ns(0.2))) is known


OVER_A_LINK = """
title = "A networked loop"
connect = ["plant.x -> controller.x : up", "controller.u -> plant.u"]
[run]
end = 1.0
step = 0.05
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
[links.up]
kind = "packet"
sample_time = 0.1
delay = 0.1
playout = 0.2
jitter = { kind = "uniform", width = 0.05 }
loss = 0.1
[design]
system = "networked.toml"
gain = [[-3.75, -11.5]]
"""


@pytest.mark.slow
def test_a_gain_of_a_scenario_is_proved_for_its_links(tmp_path: Path, native_fmus: Path) -> None:
    """The claim is that of the ages the link justifies; it is kept, and a study does without."""
    (tmp_path / "networked.toml").write_text(NETWORKED, "utf-8")
    (tmp_path / "over.toml").write_text(OVER_A_LINK, "utf-8")
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    gammas = []
    for of_links in (True, True, False):
        loaded = load(str(tmp_path / "over.toml"))
        found = prepare(loaded, cache, of_links=of_links)
        assert found.design is not None
        assert found.problem is not None
        assert found.source is not None
        gammas.append(found.design.gamma)
        late = found.problem.system.delays[0]
        assert (late.least_age, late.sampled) == ((0.25, True) if of_links else (0.0, False))
        assert found.source.made == (len(gammas) != 2)
    assert gammas[0] == gammas[1] < gammas[2]  # type: ignore[operator]
