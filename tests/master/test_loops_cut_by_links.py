"""Links that never read the present row cut an algebraic loop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from loops import ENGINES, LOOP, PAIR, POINTS, STEP, STOP, advanced, declared, output, settled
from scalar import end, ns, scalars

from cosim.core import InputError
from cosim.master import DelaySource, EngineName, receiving_order, simulate
from cosim.network import DelayProfile, DelaySignal, PacketLink, TransportLink


@pytest.mark.parametrize("delay", [0.1, 0.25])
@pytest.mark.parametrize("both", [True, False])
@pytest.mark.parametrize("engine", ENGINES)
def test_transport_delay_cuts_a_loop(delay: float, engine: EngineName, *, both: bool) -> None:
    """Read at once only at the start, where the initialisation solves it; then by hand."""
    link = TransportLink("l", ns(delay))
    pairs = (LOOP[0], ("q.y", "p.u", "l")) if not both else tuple((*c, "l") for c in LOOP)
    system = scalars(declared(), PAIR, pairs, step=STEP, stop=STOP, links=[link])
    order = receiving_order(system)
    assert (order.cut, order.loops) == ((), ())
    assert len(order.initialised) == 1 + both
    run = simulate(system, engine=engine)
    x, y = {"p": 1.0, "q": -0.5}, dict(zip(PAIR, settled(), strict=True))
    sent: dict[str, list[float]] = {"p": [], "q": []}

    def read(name: str, k: int) -> float:
        t = max(k - delay / STEP, 0.0)
        i = math.floor(t + 1e-9)
        share = t - i if t - i > 1e-9 else 0.0
        if not sent[name]:
            return y[name]
        return sent[name][i] * (1 - share) + (share and sent[name][i + 1] * share)

    for k in range(POINTS):
        u = {"p": read("q", k), "q": read("p", k)}
        sent["p"].append(output("p", x["p"], u["p"]))
        if not both:
            u["q"] = sent["p"][k]
        sent["q"].append(output("q", x["q"], u["q"]))
        x = {name: advanced(name, x[name], u[name]) for name in x}
    for name, values in sent.items():
        assert run.signal(name, "y") == pytest.approx(values, rel=1e-10), name


@pytest.mark.parametrize(
    ("link", "policy", "cuts"),
    [
        (TransportLink("l", ns(0.1)), "hold", True),
        (TransportLink("l", ns(0.099)), "hold", False),
        (TransportLink("l", ns(0.15)), "midpoint", True),
        (TransportLink("l", ns(0.1)), "midpoint", True),
        (TransportLink("l", ns(0.1)), "linear", True),
        (TransportLink("l", ns(0.099)), "linear", False),
        (TransportLink("l", 0, DelayProfile.from_seconds([0, 1], [0.3, 0.1], "linear")), "hold", 1),
        (TransportLink("l", 0, DelayProfile.from_seconds([0, 1], [0.3, 0.0], "linear")), "hold", 0),
        (PacketLink("l", ns(0.1), delay_ns=1), "hold", True),
        (PacketLink("l", ns(0.1)), "hold", False),
    ],
)
def test_link_cuts_a_loop_if_it_never_reads_the_present_row(
    link: Any, policy: str, *, cuts: bool
) -> None:
    pairs = (LOOP[0], ("q.y", "p.u", "l", policy))
    system = scalars(declared(), PAIR, pairs, step=STEP, stop=STOP, links=[link])
    if cuts:
        assert simulate(system).status == "finished"
        return
    with pytest.raises(InputError, match="algebraic loop"):
        receiving_order(system)


def test_transport_delay_of_a_step_cuts_where_points_are_added() -> None:
    """The points are not known before the run, but no two are more than a step apart."""
    live = PacketLink("live", ns(0.07), 0, delay=DelaySignal(0.05, ns(0.02)))
    for delay, cuts in ((0.1, True), (0.09, False)):
        system = scalars(
            declared(),
            {**PAIR, "r": {}},
            (LOOP[0], ("q.y", "p.u", "l"), ("p.x", "r.u", "live")),
            step=STEP,
            stop=STOP,
            links=[TransportLink("l", ns(delay)), live],
            delays={"live": DelaySource((end("p.x"),), (0.0,))},
        )
        assert system.grows
        if not cuts:
            with pytest.raises(InputError, match="algebraic loop"):
                receiving_order(system)
            continue
        run = simulate(system)
        assert run.status == "finished"
        assert run.signal("p", "u")[0] == pytest.approx(settled()[1], rel=1e-11)
        t = run.points_ns / 1e9
        expected = np.interp(np.maximum(t - delay, 0.0), t, run.signal("q", "y"))
        assert run.signal("p", "u") == pytest.approx(expected, rel=1e-9)
