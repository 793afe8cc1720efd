"""Links inside the loop: what a receiver sees, replayed message by message."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from coupled import ns, section_5, system

from cosim.master import simulate
from cosim.network import GilbertElliott, Jitter, PacketLink, TransportLink, draws

if TYPE_CHECKING:
    from pathlib import Path

    from cosim.master import Run

STOP = 3.0
STEP = 0.05
SIGNALS = ("x[1]", "x[2]", "z[1]", "z[2]", "u[1]", "w[1]")

LINKS = {
    "delay": {"delay_ns": ns(0.12)},
    "jitter, newest wins": {"delay_ns": ns(0.05), "jitter": Jitter("uniform", width_ns=ns(0.3))},
    "jitter, fifo": {
        "delay_ns": ns(0.05),
        "jitter": Jitter("exponential", mean_ns=ns(0.1), max_ns=ns(0.4)),
        "order": "fifo",
    },
    "jitter, as arrived": {
        "jitter": Jitter("normal", mean_ns=ns(0.1), sigma_ns=ns(0.1)),
        "order": "as-arrived",
    },
    "loss, hold": {"delay_ns": ns(0.07), "loss": 0.4},
    "loss, zero": {"delay_ns": ns(0.07), "loss": 0.4, "on_loss": "zero"},
    "bursts, value": {
        "delay_ns": ns(0.02),
        "loss": GilbertElliott(0.2, 0.4),
        "on_loss": -1.5,
        "jitter": Jitter("uniform", width_ns=ns(0.2)),
    },
    "loss, fifo, zero": {
        "loss": 0.3,
        "order": "fifo",
        "on_loss": "zero",
        "jitter": Jitter("uniform", width_ns=ns(0.3)),
    },
    "quantized": {"delay_ns": ns(0.1), "quantization": 0.25},
    "late first message": {"offset_ns": ns(0.42), "delay_ns": ns(0.3)},
}


def packet(name: str = "sc", **options: Any) -> PacketLink:
    return PacketLink(name, **{"sample_time_ns": ns(0.1), "seed": 5, **options})


def up(t: int, points: list[int]) -> int:
    """First point at or after t; t itself beyond the last."""
    return next((p for p in points if p >= t), t)


def replayed(
    link: PacketLink, sent: np.ndarray, points: list[int], start: float, *, grid: bool
) -> list[float]:
    """What the receiver holds at each point, by going through the messages one at a time.

    `sent` are the sender's values at the points. Only what chance decides is drawn: how long each
    message is on its way, and which are lost.
    """
    count = (points[-1] - link.offset_ns) // link.sample_time_ns + 1
    transit = link.delay_ns + draws.jitter_ns(link.jitter, link.seed, link.name, count)
    losses = draws.lost(link.loss, link.seed, link.name, count)
    events = []
    latest = 0
    for i in range(count):
        send = link.offset_ns + i * link.sample_time_ns
        send = up(send, points) if grid else send
        arrival = send + int(transit[i])
        arrival = up(arrival, points) if grid else arrival
        if link.order == "fifo":
            arrival = max(arrival, latest)
            latest = latest if losses[i] else arrival
        if send <= points[-1]:
            events.append((arrival, i, bool(losses[i]), float(sent[points.index(send)])))
    events.sort()
    value_in_use, newest, seen = start, -1, []
    for t in points:
        while events and events[0][0] <= t:
            _, i, lost, value = events.pop(0)
            if lost:
                if link.on_loss != "hold" and i > newest:
                    value_in_use = 0.0 if link.on_loss == "zero" else float(link.on_loss)
                continue
            if i > newest or link.order == "as-arrived":
                if link.quantization:
                    value = round(value / link.quantization) * link.quantization
                value_in_use = value
            newest = max(newest, i)
        seen.append(value_in_use)
    return seen


@pytest.mark.parametrize("events", ["align", "grid"])
@pytest.mark.parametrize("case", LINKS)
def test_receiver_sees_the_replayed_deliveries(fmus: Path, case: str, events: str) -> None:
    """At every point, for either policy, to the bit."""
    link = packet(**LINKS[case])
    run = simulate(section_5(fmus, step=STEP, stop=STOP, links=[link], events=events))
    points = [int(t) for t in run.points_ns]
    for i in (1, 2):
        expected = replayed(
            link, run.signal("plant", f"x[{i}]"), points, 0.0, grid=events == "grid"
        )
        assert run.signal("controller", f"x[{i}]").tolist() == expected


@pytest.mark.parametrize("sample_time", [STEP, 0.01])
def test_packet_link_without_delay_is_a_wire(fmus: Path, sample_time: float) -> None:
    """Zero delay, no loss, sent at every point: bit for bit the run without a link."""
    links = [packet(name, sample_time_ns=ns(sample_time)) for name in ("sc", "ca")]
    run = simulate(section_5(fmus, step=sample_time, stop=STOP, links=links))
    wire = simulate(section_5(fmus, step=sample_time, stop=STOP))
    assert np.array_equal(run.points_ns, wire.points_ns)
    for signal in SIGNALS:
        assert np.array_equal(run.signal("plant", signal), wire.signal("plant", signal))


def test_transport_link_without_delay_is_a_wire(fmus: Path) -> None:
    """The same for the continuous kind."""
    links = [TransportLink("sc"), TransportLink("ca")]
    run = simulate(section_5(fmus, step=STEP, stop=STOP, links=links))
    wire = simulate(section_5(fmus, step=STEP, stop=STOP))
    for signal in SIGNALS:
        assert np.array_equal(run.signal("plant", signal), wire.signal("plant", signal))


def test_packet_link_with_delays_on_the_grid_is_a_transport_link(fmus: Path) -> None:
    """Sent at every point, on its way for four steps: the two kinds agree after the start."""
    one = simulate(
        section_5(
            fmus,
            step=STEP,
            stop=STOP,
            links=[packet(sample_time_ns=ns(STEP), delay_ns=ns(4 * STEP))],
            plant={"initial.x[1]": 0.0, "initial.x[2]": 0.0},
        )
    )
    other = simulate(
        section_5(
            fmus,
            step=STEP,
            stop=STOP,
            links=[TransportLink("sc", ns(4 * STEP))],
            plant={"initial.x[1]": 0.0, "initial.x[2]": 0.0},
        )
    )
    for signal in SIGNALS:
        assert np.array_equal(one.signal("plant", signal), other.signal("plant", signal))


def test_inputs_keep_their_start_before_the_first_delivery(fmus: Path) -> None:
    """A start value given as a parameter stays until a message has arrived, then never returns."""
    link = packet("line", delay_ns=ns(0.55))
    run = simulate(
        system(
            fmus,
            {
                "plant": ("DelayedPlant", {}),
                "controller": ("PaperController", {"x[1]": 7.0, "x[2]": -2.0}),
            },
            [("plant.x[1]", "controller.x[1]", "line")],
            step=STEP,
            stop=1.0,
            links=[link],
        )
    )
    seen, t = run.signal("controller", "x[1]"), run.points_ns / 1e9
    assert set(seen[t < 0.55]) == {7.0}
    assert seen[t >= 0.55][0] == 10.0
    u = run.signal("controller", "u[1]")
    assert u[1] == pytest.approx(0.6432 * 7.0 + 0.5679 * 2.0)  # x[2] is unconnected and stays


def test_aligned_events_become_points_and_grid_events_do_not(fmus: Path) -> None:
    """Align: sends and arrivals are points; grid: nothing but multiples of the step."""
    link = packet(sample_time_ns=ns(0.13), delay_ns=ns(0.031))
    aligned = simulate(section_5(fmus, step=STEP, stop=1.0, links=[link]))
    grid = simulate(section_5(fmus, step=STEP, stop=1.0, links=[link], events="grid"))
    sends = [k * ns(0.13) for k in range(8)]
    arrivals = [t + ns(0.031) for t in sends if t + ns(0.031) <= ns(1.0)]
    multiples = [k * ns(STEP) for k in range(21)]
    assert aligned.points_ns.tolist() == sorted({*sends, *arrivals, *multiples})
    assert grid.points_ns.tolist() == multiples
    # never early: what is seen on the grid was sent at least the delay before
    late = grid.signal("controller", "x[1]")
    sent = grid.signal("plant", "x[1]")
    for k, value in enumerate(late[1:], 1):
        if value:
            assert multiples[k] - multiples[sent.tolist().index(value)] >= ns(0.031)


def test_seed_and_name_decide_the_draws(fmus: Path) -> None:
    """Same seed, same rows; another seed, or another name, other rows."""
    link = packet("line", loss=0.5, jitter=Jitter("uniform", width_ns=ns(0.2)))
    runs = [
        seen(fmus, link),
        seen(fmus, link),
        seen(fmus, dataclasses.replace(link, seed=6)),
        seen(fmus, dataclasses.replace(link, name="other")),
    ]
    assert runs[0] == runs[1]
    assert runs[0] != runs[2]
    assert runs[0] != runs[3]


def seen(fmus: Path, link: PacketLink) -> list[tuple[int, float]]:
    run: Run = simulate(
        system(
            fmus,
            {"plant": ("DelayedPlant", {})},
            [("plant.x[2]", "plant.w[1]", link.name)],
            step=STEP,
            stop=1.0,
            links=[link],
        )
    )
    return list(zip(run.points_ns.tolist(), run.signal("plant", "w[1]").tolist(), strict=True))
