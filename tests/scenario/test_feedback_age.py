"""What settings say of the age of the feedback holds in runs, and proofs are held against both."""

from __future__ import annotations

import io
import random
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from as_scenario import scenario_of
from claims import Claims, claiming
from cli.shell import cosim
from master.scalar import end, ns, scalar_fmu
from random_runs import RandomRuns
from rich.console import Console
from shared import fmu_store

from cosim.core import InputError, NotAchievableError
from cosim.fmu import FmuDescription, describe_fmu
from cosim.master import Component, Connection, Link, System, make_schedule
from cosim.network import (
    DelayProfile,
    GilbertElliott,
    Hop,
    Jitter,
    Medium,
    Node,
    PacketLink,
    Recording,
    TransportLink,
)
from cosim.scenario import (
    FmuCache,
    PreparedScenario,
    ScenarioPart,
    Wanted,
    assembled_system,
    execute_run,
    execute_unrecorded,
    load,
    open_source,
    parse,
    prepare,
    problem_of,
)
from cosim.trace import describe, render
from cosim.trace.outcome import assumptions_of

STEP = ns(0.05)
UP = [("plant.eta.x", "controller.eta.x"), ("plant.nu.u", "controller.nu.u")]
DOWN = [("controller.force.x", "plant.force.x")]


@pytest.fixture(scope="module")
def fmus(native_fmus: Path) -> Mapping[str, FmuDescription]:
    return {
        "plant": describe_fmu(native_fmus / "AuvPlant.fmu"),
        "controller": describe_fmu(native_fmus / "HinfController.fmu"),
    }


@dataclass(frozen=True)
class Known:
    """What an outcome says of the ages of a loop, by its settings and in its run [ns]."""

    settings: Mapping[str, Any]
    measured: Mapping[str, Any] | None
    alike: bool

    @property
    def sampled(self) -> bool:
        """Whether they say that it is sampled."""
        return bool(self.settings["sampled"])

    @property
    def why(self) -> str:
        """Why it is, or what prevents it."""
        return str(self.settings["why"])

    @property
    def least_ns(self) -> int:
        """It is never less."""
        return ns(self.settings["least_s"])

    @property
    def greatest_ns(self) -> int | None:
        """It is never more."""
        most = self.settings["greatest_s"]
        return None if most is None else ns(most)


def known_of(
    fmus: Mapping[str, FmuDescription],
    up: Link | None,
    down: Link | None,
    *,
    instants: Any = "align",
    sample_time: float = 0.05,
    points: int = 160,
    **tables: Any,
) -> Known:
    """A run of the vehicle and its controller, with a link or a wire each way."""
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
    schedule = make_schedule(links, STEP, points * STEP, instants)
    system = System(components, wires, links, {}, schedule)
    text = tomli_w.dumps(scenario_of(system, design={"file": "auv-1.25s"}, **tables))
    folder = fmus["plant"].path.parent
    loaded = parse(text, name="age", where="age.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(folder.parent, folder, flavour="native"))
    made = assembled_system(prepared)[0]
    assert tables or made.links == links
    wanted = Wanted(["metrics.feedback_age", "metrics.assumptions"])
    outcome, _ = execute_unrecorded(prepared, zero_state_run=False, wanted=wanted)
    age = outcome.metrics["feedback_age"]
    alike = outcome.metrics["assumptions"].get("measurements_equally_old", True)
    return Known(age["settings"], age["measured"], alike)


def check(known: Known) -> Known:
    """What is known of the ages holds in the run."""
    found = known.measured
    if found is None or found["least_s"] is None:
        return known
    assert ns(found["least_s"]) >= known.least_ns
    if known.greatest_ns is not None:
        assert ns(found["greatest_s"]) <= known.greatest_ns
    if known.sampled:
        assert [ns(x) for x in found["in_use_s"]] == [known.least_ns, known.least_ns]
        assert known.alike
        if known.greatest_ns is not None:
            assert ns(found["greatest_s"]) == known.greatest_ns
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
        known = known_of(fmus, up, down, instants=events, sample_time=sample)
        seen.append(check(known).sampled)
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
        known = check(known_of(fmus, up, None))
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
    for seed in range(60):
        made = runs.run(seed)
        age = None if made is None else made.outcome.metrics["feedback_age"]
        if age is None or None in (age["settings"], age["measured"]):
            continue
        known, found = age["settings"], age["measured"]
        if found["least_s"] is None:
            continue
        assert found["least_s"] >= known["least_s"], seed
        assert known["greatest_s"] is None or found["greatest_s"] <= known["greatest_s"], seed
        checked += 1
    assert checked > 10


AHEAD = """
title = "A transport link that is read half a step ahead"
[run]
end = 2.0
step = 0.05
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
feedthrough = ["u"]
[[connections]]
from = "plant.x"
to = "controller.x"
link = "up"
policy = "midpoint"
[[connections]]
from = "controller.u"
to = "plant.u"
[links.up]
kind = "transport"
delay = 0.125
[design]
file = "paper-late"
"""


def test_what_is_read_ahead_is_younger_than_its_link(native_fmus: Path, tmp_path: Path) -> None:
    """The settings say so too."""
    loaded = parse(AHEAD, name="a", where="a.toml", folder=tmp_path)
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    age = execute_unrecorded(prepare(loaded, cache))[0].metrics["feedback_age"]
    assert age["settings"]["least_s"] <= age["measured"]["least_s"] < 0.125


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
    known = known_of(fmus, up, down, points=4)
    assert not known.sampled
    assert words in known.why


def test_over_a_medium_any_message_may_be_lost_and_none_is_younger_than_its_airtime(
    fmus: Mapping[str, FmuDescription],
) -> None:
    """Another link may collide with it at any time: there is no greatest age, but a least one."""
    known = known_of(fmus, ON_MEDIUM, None)
    assert known.greatest_ns is None
    assert known.least_ns >= ON_MEDIUM.frame_ns
    buffered = known_of(fmus, replace(ON_MEDIUM, playout_ns=STEP), None)
    assert buffered.sampled
    assert buffered.greatest_ns is None


def test_losses_on_both_ways_are_sampled_only_one_at_a_time(
    fmus: Mapping[str, FmuDescription],
) -> None:
    """A command that is lost brings its measurement back later, unless a newer one came."""
    sure = replace(BUFFERED, loss=0.0)
    window = {"events": [{"at": 0.0, "until": STEP / 1e9, "loss": {"down": 1.0}}]}
    for up, down, tables, sampled in (
        (BUFFERED, replace(sure, name="down"), {}, True),
        (sure, replace(BUFFERED, name="down"), {}, True),
        (BUFFERED, replace(BUFFERED, name="down"), {}, False),
        (BUFFERED, replace(sure, name="down"), window, False),
    ):
        assert check(known_of(fmus, up, down, **tables)).sampled == sampled
    late = replace(sure, jitter=Jitter("uniform", width_ns=6 * STEP))
    assert known_of(fmus, late, None).greatest_ns is None
    assert known_of(fmus, sure, None).greatest_ns == 7 * STEP + STEP + 3 * STEP


@pytest.fixture(scope="module")
def playout(native_fmus: Path) -> Claims:
    """Ages that are exactly 0.35 s as a measurement comes into use, and 0.95 s at most."""
    claims = Claims(load("auv-acoustic-playout", ("run.end=10",)), native_fmus)
    age = claims.metrics(claims.design)["feedback_age"]["measured"]
    assert age == {"least_s": 0.35, "greatest_s": 0.95, "in_use_s": [0.35, 0.35]}
    assert claims.unmet(claims.design) == set()
    return claims


FROM_LEAST = "any, however it varies, from least_age to d"


@pytest.mark.parametrize(
    ("claimed", "wrong"),
    [
        ({}, set()),
        ({"d": 0.95}, set()),
        ({"d": 0.95 - 1e-9}, {"message_age_within_design"}),
        ({"age": FROM_LEAST}, set()),
        ({"age": FROM_LEAST, "least_age": 0.35 + 1e-9}, {"message_age_not_below_least"}),
        ({"least_age": 0.35 - 1e-9}, {"message_age_sampled"}),
        (
            {"least_age": 0.35 + 1e-9},
            {"message_age_not_below_least", "message_age_sampled"},
        ),
    ],
)
def test_each_fault_of_an_age_fails_its_own_assumption(
    claimed: dict[str, Any], wrong: set[str], playout: Claims
) -> None:
    """Too old, below the least age, another age in use: by 1 ns."""
    assert playout.unmet(claiming(playout.design, **claimed)) == wrong


@pytest.mark.parametrize(
    ("settings", "wrong"),
    [
        (("links.fixes.offset=1.2",), {"message_age_within_design"}),
        (
            ("links.fixes.loss=1.0",),
            {"message_age_within_design", "message_age_not_below_least", "message_age_sampled"},
        ),
        (
            ("links.fixes.on_loss=0.0", "links.fixes.loss=0.5", "run.end=5"),
            {"message_age_within_design"},
        ),
    ],
)
def test_each_fault_of_a_link_fails_its_own_assumption(
    settings: tuple[str, ...], wrong: set[str], native_fmus: Path
) -> None:
    """Late at first, no measurement at all, a substitute that interrupts."""
    claims = Claims(load("auv-acoustic-playout", ("run.end=10", *settings)), native_fmus)
    claimed = claiming(claims.design, d=1.45)  # older ones count, so that the start alone is late
    assert {x for x in claims.unmet(claimed) if x.startswith("m")} == wrong


def test_parts_that_are_not_equally_old_fail_two_assumptions(native_fmus: Path) -> None:
    """Velocities over another link: no gain acts on one age then, and none is the sampled one."""
    data = tomllib.loads(open_source("auv-acoustic-playout").text)
    data["links"]["other"] = {**data["links"]["fixes"], "playout": 0.35}
    for wire in data["connections"]:
        if wire["to"] == "controller.nu":
            wire["link"] = "other"
    loaded = parse(tomli_w.dumps(data), name="p", where="p.toml", folder=Path())
    claims = Claims(loaded, native_fmus)
    found = claims.unmet(claims.design)
    assert {"message_age_sampled", "measurements_equally_old"} <= found


@pytest.mark.parametrize(
    "word", ["constant, exactly d", "constant, up to d", "constant, from 1/2 to d", "unheard of"]
)
def test_no_proof_of_a_constant_age_covers_a_run(word: str, playout: Claims) -> None:
    """However little it varies: the proof is about another loop; no rule of a word: of none."""
    found = playout.metrics(claiming(playout.design, age=word))["departures"]
    (got,) = [one["got"] for one in found if one["assumption"] == "message_age_constant"]
    assert got.startswith("what is used is held, up to 0.95 s old")


def printed(view: Any) -> str:
    """What a terminal shows, in one line."""
    console = Console(width=300, file=io.StringIO())
    console.print(view)
    return " ".join(console.file.getvalue().split())  # type: ignore[attr-defined]


def printed_by_run(playout: str, folder: Path) -> str:
    """What `cosim run` prints of the built-in scenario with this buffer, in one line."""
    settings = ("--set", f"links.fixes.playout={playout}", "--set", "run.end=40")
    line = ("run", "auv-acoustic-playout", *settings, "--fmus", fmu_store("native"))
    return " ".join(cosim(*line, cwd=folder, columns=300).out.split())


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
        for text in (printed_by_run(playout, tmp_path), printed(render(info))):
            assert "sampled: exactly 0.35 s when a measurement comes into use" in text
            assert words in text
        checks = {check.what: check for check in assumptions_of(results[playout])}
        used = checks["Every measurement came into use at the age of the proof"]
        assert words in used.why if playout == "0.3" else "0.35 s old when" in used.why
    assert "dropped late mean delay" in printed_by_run("0.3", tmp_path)


def design_part(**keys: Any) -> Any:
    """The table [design] of a scenario."""
    data = {"title": "t", "run": {"end": 1.0, "step": 0.1}, "components": {"a": {"fmu": "A"}}}
    return ScenarioPart.model_validate({**data, "design": keys}).design


def test_design_takes_the_keys_of_ages(tmp_path: Path) -> None:
    """As in the file of a system; a rate, or an age of immediate feedback, is refused."""
    part = design_part(system="auv", loop_delay=1.25, least_age=0.35, sampled=True)
    late = problem_of(part, tmp_path).system.delays[1]
    assert (late.d, late.least_age, late.sampled) == (1.25, 0.35, True)
    for given, where in (
        ({"system": "paper", "sampled": True}, "design.sampled"),
        ({"system": "auv", "loop_delay": 1.0, "least_age": 1.0}, "design.least_age"),
    ):
        with pytest.raises(InputError) as caught:
            problem_of(design_part(**given), tmp_path)
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


def networked(folder: Path, fmus: Path, *settings: str, of_links: bool = True) -> PreparedScenario:
    """The scenario over a link, in a folder, prepared."""
    (folder / "networked.toml").write_text(NETWORKED, "utf-8")
    (folder / "over.toml").write_text(OVER_A_LINK, "utf-8")
    loaded = load(str(folder / "over.toml"), settings)
    cache = FmuCache(fmus.parent, folder, flavour="native")
    return prepare(loaded, cache, of_links=of_links)


def test_a_design_for_a_bounded_rate_flies_over_no_link(tmp_path: Path, native_fmus: Path) -> None:
    """Values are held: their age grows at rate one and falls."""
    with pytest.raises(NotAchievableError, match="no bounded rate"):
        networked(tmp_path, native_fmus, "design.rate=0.5")


def test_a_run_says_what_proves_a_gain_of_a_constant_age(tmp_path: Path, native_fmus: Path) -> None:
    """The command, of the file that the scenario names."""
    file = Path(__file__).parents[1] / "corpus" / "certificates" / "constant-up-to.json"
    text = OVER_A_LINK.partition("[design]")[0] + f'[design]\nfile = "{file}"\n'
    loaded = parse(text, name="c", where="c.toml", folder=tmp_path)
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    found = execute_unrecorded(prepare(loaded, cache))[0].metrics["departures"]
    (got,) = [one["got"] for one in found if one["assumption"] == "message_age_constant"]
    assert f"proved anew by: cosim certificate prove {file}" in got


@pytest.mark.parametrize(
    ("settings", "known"),
    [
        (("links.up.playout=0.2",), (0.25, True)),
        (("links.up.playout=0", "links.up.jitter.width=0.04"), (0.0, False)),
        (("links.up.playout=0.55",), (0.0, False)),
        (("links.up.playout=0", "links.up.delay=0", "links.up.jitter.width=0.04"), (0.0, False)),
        (("links.up.playout=0.2", "design.least_age=0.2"), (0.2, False)),
    ],
)
def test_links_sharpen_a_problem_that_says_any_age(
    settings: tuple[str, ...], known: tuple[float, bool], tmp_path: Path, native_fmus: Path
) -> None:
    """Sampled, where that proves more; not below zero, beyond the bound, or what is known."""
    problem = networked(tmp_path, native_fmus, *settings).problem
    assert problem is not None
    late = problem.system.delays[0]
    assert (late.least_age, late.sampled) == known


@pytest.mark.slow
def test_a_gain_of_a_scenario_is_proved_for_its_links(tmp_path: Path, native_fmus: Path) -> None:
    """The claim is that of the ages the link justifies; it is kept, and a study does without."""
    gammas = []
    for of_links in (True, True, False):
        found = networked(tmp_path, native_fmus, of_links=of_links)
        assert found.design is not None
        assert found.problem is not None
        assert found.source is not None
        gammas.append(found.design.gamma)
        late = found.problem.system.delays[0]
        assert (late.least_age, late.sampled) == ((0.25, True) if of_links else (0.0, False))
        assert found.source.made == (len(gammas) != 2)
    assert gammas[0] == gammas[1] < gammas[2]  # type: ignore[operator]
