"""The policy previous: what a receiver reads is that of the communication point before."""

from __future__ import annotations

import numpy as np
import pytest
from loops import ENGINES, LOOP, PAIR, STEP, STOP, declared, settled
from scalar import end, ns, scalars

from cosim.core import ComponentError, InputError
from cosim.master import DelaySource, EngineName, Session, simulate
from cosim.network import DelayProfile, DelaySignal, PacketLink, TransportLink

SOURCE = {"a": -1.0, "x0": 1.0, "g": 0.5, "e": 0.3}
AFTER = {
    "wire": (),
    "transport": (TransportLink("l", ns(0.13)),),
    "varying transport": (
        TransportLink("l", 0, DelayProfile.from_seconds([0.0, 1.0], [0.25, 0.1], "linear")),
    ),
    "packet": (PacketLink("l", ns(0.07), ns(0.01), ns(0.0331)),),
    "packet at once": (PacketLink("l", ns(0.1), quantization=0.01),),
    "lost packets": (
        PacketLink("l", ns(0.1), loss=0.5, on_loss="zero", seed=3, delay_ns=ns(0.03)),
    ),
    "live": (PacketLink("l", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02))),),
}


@pytest.mark.parametrize("events", ["align", "grid"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("case", AFTER)
@pytest.mark.parametrize("engine", ENGINES)
def test_previous_is_hold_one_point_later(
    case: str, algorithm: str, events: str, engine: EngineName
) -> None:
    """One sender, two receivers: what one reads at a point, the other reads at the next."""
    names = {n: {"a": -1.0} for n in ("one", "other")}
    over = "l" if AFTER[case] else ""
    run = simulate(
        scalars(
            declared(),
            {"source": SOURCE, "feed": {"a": -0.2, "x0": 1.0}, **names},
            (
                ("feed.x", "source.u"),
                ("source.y", "one.u", over),
                ("source.y", "other.u", over, "previous"),
            ),
            step=STEP,
            stop=STOP,
            links=AFTER[case],
            algorithm=algorithm,
            events=events,
            delays={"l": DelaySource((end("feed.x"),))} if case == "live" else {},
        ),
        engine=engine,
    )
    assert run.status == "finished"
    one, other = run.signal("one", "u"), run.signal("other", "u")
    assert other[0] == one[0] or algorithm == "gauss-seidel"
    assert np.array_equal(other[1:], one[:-1])
    assert len(set(other.tolist())) > 4


@pytest.mark.parametrize("case", ["wire", "transport", "varying transport", "packet at once"])
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("engine", ENGINES)
def test_previous_where_points_are_added(case: str, algorithm: str, engine: EngineName) -> None:
    """A live link elsewhere adds points during the run: the point before may be one of them."""
    over = "l" if AFTER[case] else ""
    system = scalars(
        declared(),
        {"source": SOURCE, "one": {}, "other": {}, "far": {}},
        (
            ("source.y", "one.u", over),
            ("source.y", "other.u", over, "previous"),
            ("source.x", "far.u", "live"),
        ),
        step=STEP,
        stop=STOP,
        links=[*AFTER[case], PacketLink("live", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02)))],
        algorithm=algorithm,
        delays={"live": DelaySource((end("source.x"),))},
    )
    assert system.grows
    run = simulate(system, engine=engine)
    assert run.status == "finished"
    one, other = run.signal("one", "u"), run.signal("other", "u")
    assert np.array_equal(other[1:], one[:-1])
    assert run.points_ns.size > 30
    assert len(set(one.tolist())) > 8


@pytest.mark.parametrize("every_s", [{"source": 0.2}, {"one": 0.3, "other": 0.3}])
@pytest.mark.parametrize("engine", ENGINES)
def test_previous_with_own_steps(every_s: dict[str, float], engine: EngineName) -> None:
    """The communication point before: for a slow receiver too, that of the run."""
    run = simulate(
        scalars(
            declared(),
            {"source": SOURCE, "one": {}, "other": {}},
            (("source.y", "one.u"), ("source.y", "other.u", "", "previous")),
            step=STEP,
            stop=1.2,
            every=every_s,
        ),
        engine=engine,
    )
    y = run.signal("source", "y")
    for k in range(run.points_ns.size):
        if "one" in every_s and k % 3:
            continue
        before = max(k - 1, 0)
        assert run.signal("other", "u")[k] == y[before // 2 * 2 if "source" in every_s else before]


def test_start_of_a_cut_survives_a_restore() -> None:
    """Back to before the first step: the value of the initialisation is in its row again."""
    policy = (LOOP[0], ("q.y", "p.u", "", "previous"))
    with Session(scalars(declared(), PAIR, policy, step=STEP, stop=STOP)) as session:
        start = session.snapshot()
        session.run_until()
        first = session.result().signal("p", "y").copy()
        session.restore(start)
        session.run_until()
        assert np.array_equal(session.result().signal("p", "y"), first)
    assert first[0] == pytest.approx(settled()[0], rel=1e-11)


def test_loop_that_does_not_settle_at_the_start_is_named() -> None:
    strong = {name: given | {"e": 2.0} for name, given in PAIR.items()}
    pairs = (LOOP[0], ("q.y", "p.u", "", "previous"))
    with pytest.raises(ComponentError, match="the initial values do not settle"):
        simulate(scalars(declared(), strong, pairs, step=STEP, stop=STOP))


def test_unknown_policy_is_refused() -> None:
    with pytest.raises(InputError, match="did you mean previous"):
        scalars(declared(), PAIR, (("p.y", "q.u", "", "previuos"),), step=STEP, stop=STOP)
