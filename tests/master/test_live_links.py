"""Links whose delay follows a signal of the run, and the state of links as signals."""

from __future__ import annotations

import heapq
import itertools
import math
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled import rewritten
from scalar import end, ns, scalar_fmu, scalars

from cosim.core import InputError
from cosim.master import DelaySource, EngineName, Run, Session, Snapshot, System, simulate
from cosim.network import DelayProfile, DelaySignal, Jitter, PacketLink, TransportLink

A, B, START = (-1.0, -0.5), (1.5, -2.0), (1.0, 0.8)
PAIR = {n: {"a": A[i], "b": B[i], "x0": START[i]} for i, n in enumerate(("a", "b"))}
STOP = 2.0
SCALE, OFFSET = 0.05, 0.02  # seconds per unit, seconds
SIGNAL = DelaySignal(SCALE, ns(OFFSET))


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scalar_fmu(tmp_path_factory.mktemp("scalar"))


@pytest.fixture(params=["python", "kernel"])
def engine(request: pytest.FixtureRequest) -> EngineName:
    name: EngineName = request.param
    return name


def ranged(fmu: Path, **more: Any) -> System:
    """a tells b over a link whose delay is 0.02 s + 0.05 s |x_a|; b tells a over another one."""
    links = (
        PacketLink("there", ns(0.07), ns(0.01), delay=SIGNAL, order="as-arrived"),
        PacketLink("back", ns(0.05), 0, ns(0.0207)),
    )
    given: dict[str, Any] = {
        "step": 0.1,
        "stop": STOP,
        "links": links,
        "delays": {"there": DelaySource((end("a.x"),), (0.0,))},
    }
    return scalars(fmu, PAIR, (("a.x", "b.u", "there"), ("b.x", "a.u", "back")), **given | more)


def advanced(x: list[float], u: list[float], h: float) -> list[float]:
    return [math.exp(a * h) * x[i] + math.expm1(a * h) / a * B[i] * u[i] for i, a in enumerate(A)]


def by_events(grid: float | None = None) -> list[float]:
    """Both states at the end, from one event to the next; sends and arrivals on a grid or not."""

    def up(t: int) -> int:
        return t if grid is None else -(-t // ns(grid)) * ns(grid)

    order = itertools.count()
    events: list[tuple[int, int, int, float | None]] = []
    for i, (first, every) in enumerate(((0.01, 0.07), (0.0, 0.05))):
        for sent in range(ns(first), ns(STOP) + 1, ns(every)):
            heapq.heappush(events, (up(sent), next(order), i, None))
    x, u, now = list(START), [0.0, 0.0], 0
    while events and events[0][0] <= ns(STOP):
        at, _, i, value = heapq.heappop(events)
        x, now = advanced(x, u, (at - now) / 1e9), at
        if value is None:
            delay = ns(0.0207) if i else round(1e9 * (OFFSET + SCALE * abs(x[0])))
            heapq.heappush(events, (up(at + delay), next(order), i, x[i]))
        else:
            u[1 - i] = value
    return advanced(x, u, (ns(STOP) - now) / 1e9)


def ends(run: Run) -> list[float]:
    return [run.signal(name, "x")[-1] for name in ("a", "b")]


def rows(run: Run) -> list[bytes]:
    return [run.signal(c, v).tobytes() for c in ("a", "b") for v in ("x", "u")]


@pytest.mark.parametrize("step", [0.1, 0.033, 0.5])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_delay_that_follows_a_signal_is_exact_whatever_the_step(
    fmu: Path, engine: EngineName, step: float, algorithm: str
) -> None:
    run = simulate(ranged(fmu, step=step, algorithm=algorithm), engine=engine)
    assert run.status == "finished"
    assert ends(run) == pytest.approx(by_events(), rel=1e-12)
    arrived, sent, _, _ = run.deliveries["there"].arrivals()
    at = np.searchsorted(run.points_ns, sent)
    expected = OFFSET + SCALE * np.abs(run.signal("a", "x")[at])
    assert arrived - sent == pytest.approx(1e9 * expected, abs=0.51)
    assert np.isin(arrived, run.points_ns).all()
    assert arrived.size > 20


def test_delay_that_follows_a_signal_on_a_grid(fmu: Path, engine: EngineName) -> None:
    run = simulate(ranged(fmu, step=0.01, events="grid"), engine=engine)
    assert ends(run) == pytest.approx(by_events(0.01), rel=1e-12)
    assert run.points_ns.size == 201


def test_engines_agree_with_losses_copies_and_overtaking(fmu: Path) -> None:
    link = PacketLink(
        "there",
        ns(0.03),
        0,
        jitter=Jitter("exponential", mean_ns=ns(0.05)),
        loss=0.2,
        duplicate=0.3,
        delay=SIGNAL,
        on_loss=0.5,
        quantization=1e-3,
    )
    links = (link, TransportLink("back", ns(0.07)))
    runs = [
        simulate(ranged(fmu, links=links, algorithm=algorithm), engine=engine)
        for algorithm in ("jacobi", "gauss-seidel")
        for engine in ("python", "kernel")
    ]
    assert rows(runs[0]) == rows(runs[1])
    assert rows(runs[2]) == rows(runs[3])
    assert runs[0].statistics["there"]["lost"] > 0


@pytest.mark.parametrize("live", [False, True])
def test_recorded_delay_of_a_continuous_signal(fmu: Path, *, live: bool) -> None:
    """The delay falls from 0.4 s to 0.1 s: what is read is x at that instant."""
    profile = DelayProfile.from_seconds([0.5, 1.0], [0.4, 0.1], "linear")
    links = [TransportLink("line", delay=profile), PacketLink("p", ns(0.07), delay=SIGNAL)]
    pairs = [("a.x", "b.u", "line"), *([("a.x", "a.u", "p")] if live else [])]
    delays = {"p": DelaySource((end("b.x"),), (0.0,))} if live else {}
    used = links if live else links[:1]
    run = simulate(scalars(fmu, PAIR, pairs, step=0.01, stop=STOP, links=used, delays=delays))
    t = run.points_ns / 1e9
    delay = np.interp(t, [0.5, 1.0], [0.4, 0.1])
    read = np.interp(np.maximum(t - delay, 0.0), t, run.signal("a", "x"))
    assert run.signal("b", "u") == pytest.approx(read, abs=1e-9)


def test_distance_from_the_origin_decides_the_delay(fmu: Path) -> None:
    source = DelaySource((end("a.x"), end("b.x")), (0.3, -0.4))
    run = simulate(ranged(fmu, delays={"there": source}))
    arrived, sent, _, _ = run.deliveries["there"].arrivals()
    at = np.searchsorted(run.points_ns, sent)
    x, y = run.signal("a", "x")[at] - 0.3, run.signal("b", "x")[at] + 0.4
    expected = OFFSET + SCALE * np.hypot(x, y)
    assert arrived - sent == pytest.approx(1e9 * expected, abs=0.51)


def test_distance_of_two_that_move_decides_the_delay(fmu: Path) -> None:
    """A coordinate of the origin may be a signal, between others that are numbers."""
    source = DelaySource((end("a.x"), end("a.x"), end("b.x")), (0.3, end("b.x"), -0.4))
    run = simulate(ranged(fmu, delays={"there": source}))
    arrived, sent, _, _ = run.deliveries["there"].arrivals()
    at = np.searchsorted(run.points_ns, sent)
    a, b = run.signal("a", "x")[at], run.signal("b", "x")[at]
    expected = OFFSET + SCALE * np.sqrt((a - 0.3) ** 2 + (a - b) ** 2 + (b + 0.4) ** 2)
    assert arrived - sent == pytest.approx(1e9 * expected, abs=0.51)


@pytest.mark.parametrize("events", ["align", "grid"])
def test_restore_and_continue_with_a_live_link(
    fmu: Path, engine: EngineName, events: str, tmp_path: Path
) -> None:
    step = 0.01 if events == "grid" else 0.1
    with Session(ranged(fmu, step=step, events=events), engine=engine) as session:
        session.run_until(0.7)
        before = session.snapshot()
        session.snapshot(portable=True).save(tmp_path / "s.npz")
        session.run_until()
        first = session.result()
        whole = rows(first)
        points = first.points_ns.tolist()
        session.restore(before)
        session.override("a", "x", 3.0)
        session.run_until()
        assert rows(session.result()) != whole
        session.restore(before)
        session.run_until()
        assert rows(session.result()) == whole
    with Session(ranged(fmu, step=step, events=events), engine=engine) as session:
        session.restore(Snapshot.load(tmp_path / "s.npz"))
        session.run_until()
        assert rows(session.result()) == whole
        assert session.result().points_ns.tolist() == points


def test_invalid_delay_ends_the_run(fmu: Path, engine: EngineName) -> None:
    """0.02 s + 0.05 s/unit x: negative once x < -0.4."""
    system = ranged(fmu, delays={"there": DelaySource((end("a.x"),))})
    parts = PAIR | {"a": PAIR["a"] | {"x0": -0.5}}
    system = scalars(
        fmu,
        parts,
        (("a.x", "b.u", "there"),),
        step=0.1,
        stop=STOP,
        links=[system.links["there"]],
        delays=system.delays,
    )
    run = simulate(system, engine=engine)
    assert run.status == "failed"
    assert run.reason is not None
    assert "link 'there', message 0" in run.reason


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"delays": {}}, "the delay of this link has no signal"),
        ({"delays": {"there": DelaySource((end("a.y"),))}}, "without direct feedthrough"),
        ({"delays": {"there": DelaySource((end("a.x"),), (0.0, 1.0))}}, "2 coordinates"),
        ({"every": {"a": 0.2}}, "added during the run"),
    ],
)
def test_features_incompatible_with_a_live_link_are_refused(
    fmu: Path, more: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ranged(fmu, **more)


@pytest.mark.parametrize("events", ["align", "grid"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_algebraic_loop_through_a_live_link_is_refused(
    fmu: Path, algorithm: str, events: str
) -> None:
    """y has direct feedthrough on both sides; the delay is not known before the run."""
    link = PacketLink("there", ns(0.1), delay=SIGNAL)
    parts = {name: given | {"e": 0.5} for name, given in PAIR.items()}
    given: dict[str, Any] = {
        "step": 0.1,
        "stop": STOP,
        "links": [link],
        "delays": {"there": DelaySource((end("a.x"),), (0.0,))},
        "algorithm": algorithm,
        "events": events,
    }
    looped = scalars(fmu, parts, (("a.y", "b.u", "there"), ("b.y", "a.u")), **given)
    with pytest.raises(InputError, match="form an algebraic loop") as caught:
        simulate(looped)
    assert caught.value.where in {"a -> b -> a", "b -> a -> b"}
    own = scalars(fmu, parts, (("a.y", "a.u", "there"),), **given)
    with pytest.raises(InputError, match="a -> a: the connections form an algebraic loop"):
        simulate(own)
    opened = scalars(fmu, parts, (("a.y", "b.u", "there"), ("b.x", "a.u")), **given)
    assert simulate(opened).status == "finished"


def test_snapshot_of_another_live_link_is_refused(fmu: Path) -> None:
    """The points before the run are the same; those that the links add differ."""
    links = [PacketLink("there", ns(0.1), delay=SIGNAL)]
    pairs = (("a.x", "b.u", "there"), ("b.x", "a.u"))

    def system(events: str, signal: str) -> System:
        delays = {"there": DelaySource((end(signal),), (0.0,))}
        return scalars(
            fmu, PAIR, pairs, step=0.1, stop=STOP, links=links, events=events, delays=delays
        )

    with Session(system("align", "a.x")) as session:
        session.run_until(0.7)
        kept = session.snapshot(portable=True)
    for events, signal in (("grid", "a.x"), ("align", "b.x")):
        with (
            Session(system(events, signal)) as session,
            pytest.raises(InputError, match="another system"),
        ):
            session.restore(kept)
    with Session(system("align", "a.x")) as session:
        session.restore(kept)
        assert session.time_s == 0.7


@pytest.mark.parametrize("live", [False, True])
@pytest.mark.parametrize("what", ["age", "sequence", "dropped", "delivered"])
def test_state_of_a_link_is_a_signal(
    fmu: Path, engine: EngineName, what: str, *, live: bool
) -> None:
    delay: dict[str, Any] = {"delay": SIGNAL} if live else {"delay_ns": ns(0.033)}
    link = PacketLink("there", ns(0.07), ns(0.01), loss=0.3, **delay)
    pairs = (("a.x", "b.u", "there"), (f"there.{what}", "a.u"))
    delays = {"there": DelaySource((end("a.x"),), (0.0,))} if live else {}
    system = scalars(fmu, PAIR, pairs, step=0.1, stop=STOP, links=[link], delays=delays)
    run = simulate(system, engine=engine)
    known = [column.tolist() for column in run.deliveries["there"].arrivals()]
    seen = run.signal("a", "u")
    for k, t in enumerate(run.points_ns.tolist()):
        arrived = [
            (arrival, int(sent), status)
            for arrival, sent, _, status in zip(*known, strict=True)
            if arrival <= t
        ]
        got = [sent for _, sent, status in arrived if status == 0]
        newest = max(got, default=None)
        expected = {
            "age": (t - (newest or 0)) / 1e9,
            "sequence": -1 if newest is None else (newest - ns(0.01)) // ns(0.07),
            "dropped": len(arrived) - len(got),
            "delivered": len(got),
        }[what]
        assert seen[k] == expected, t


@pytest.mark.parametrize(
    ("source", "target", "message"),
    [
        ("there.ages", "a.u", "did you mean age"),
        ("there.age", "a.a", "does not fit this target"),
        ("there.age", "b.u", "two sources"),
    ],
)
def test_link_state_into_an_unsuitable_input_is_refused(
    fmu: Path, source: str, target: str, message: str
) -> None:
    link = PacketLink("there", ns(0.07))
    with pytest.raises(InputError, match=message):
        scalars(
            fmu,
            PAIR,
            (("a.x", "b.u", "there"), (source, target)),
            step=0.1,
            stop=STOP,
            links=[link],
        )


def test_fixed_step_slave_is_refused_where_points_are_added(tmp_path: Path) -> None:
    """The points known before the run are evenly spaced, those of the arrivals are not."""
    stiff = scalar_fmu(tmp_path, variable_step=False)
    given: dict[str, Any] = {"links": [PacketLink("there", ns(0.1), delay=SIGNAL)]}
    given |= {"step": 0.1, "stop": STOP, "delays": {"there": DelaySource((end("a.x"),), (0.0,))}}
    with pytest.raises(InputError, match="steps of one size only"):
        scalars(stiff, PAIR, (("a.x", "b.u", "there"),), **given)
    on_grid = scalars(stiff, PAIR, (("a.x", "b.u", "there"),), events="grid", **given)
    assert simulate(on_grid).status == "finished"


@pytest.mark.parametrize(("link", "policy"), [("there", "hold"), (None, "linear")])
def test_link_state_over_a_link_or_with_a_policy_is_refused(
    fmu: Path, link: str | None, policy: str
) -> None:
    with pytest.raises(InputError, match="cannot pass over a link"):
        scalars(
            fmu,
            PAIR,
            (("a.x", "b.u", "there"), ("there.age", "a.u", link or "", policy)),
            step=0.1,
            stop=STOP,
            links=[PacketLink("there", ns(0.07))],
        )


@pytest.mark.parametrize(("unit", "fits"), [("s", True), ("ms", False)])
def test_age_is_in_seconds(fmu: Path, tmp_path: Path, unit: str, *, fits: bool) -> None:
    """No other unit is accepted."""
    where = (r'(name="u"[^>]*>)<Real', rf'\1<Real unit="{unit}"')
    units = ("<ModelVariables>", f'<UnitDefinitions><Unit name="{unit}"/></UnitDefinitions>\\g<0>')
    own = rewritten(fmu, tmp_path / "own.fmu", where, units)
    given: dict[str, Any] = {"step": 0.1, "stop": STOP, "links": [PacketLink("there", ns(0.07))]}
    with nullcontext() if fits else pytest.raises(InputError, match="an age is in seconds"):
        scalars(own, PAIR, (("a.x", "b.u", "there"), ("there.age", "a.u")), **given)


@pytest.mark.parametrize("events", ["align", "grid"])
@pytest.mark.parametrize(
    ("more", "status", "words", "sent"),
    [
        ({"b": {"x0": math.nan}}, "failed", "b.x is nan at t = 0 s", 0),
        ({"b": {"a": 18.2}}, "diverged", "b.x left the range of +-1e+06 at t = 0.8 s", 8),
        ({"a": {"x0": -1.0}}, "failed", "link 'there', message 0: the value makes", 0),
        ({"a": {"x0": -0.1, "a": 5.0}}, "failed", "link 'there', message 3: the value", 3),
    ],
)
def test_run_that_ends_where_a_message_was_to_be_sent(
    fmu: Path,
    engine: EngineName,
    more: dict[str, Any],
    status: str,
    words: str,
    sent: int,
    events: str,
) -> None:
    """Beyond the range there, or a value that makes no delay: the reason, and what was sent."""
    parts = {name: given | more.get(name, {}) for name, given in PAIR.items()}
    links = [PacketLink("there", ns(0.1), delay=SIGNAL)]
    system = scalars(
        fmu,
        parts,
        (("a.x", "b.u", "there"),),
        step=0.1,
        stop=STOP,
        links=links,
        events=events,
        delays={"there": DelaySource((end("a.x"),))},
    )
    run = simulate(system, engine=engine)
    assert run.status == status
    assert words in str(run.reason)
    assert run.statistics["there"]["sent"] == sent
