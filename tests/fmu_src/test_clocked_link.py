"""The link FMU with Clocks: messages sent and delivered at the instants of the link itself."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from link_runs import VARIABLES, LinkSignal
from master.events import event_fmu

from cosim.fmu import build_fmu, describe_fmu
from cosim.fmu.inspect import inspect_fmu
from cosim.master import Component, Connection, Endpoint, Session, System, make_schedule
from cosim.network import Jitter, PacketLink

MS = 1_000_000
LINKS: dict[str, dict[str, Any]] = {
    "off the grid": {"delay_ns": 123_456_789, "sample_time_ns": 70_000_001, "offset_ns": 33 * MS},
    "at once": {"delay_ns": 0, "sample_time_ns": 100 * MS},
    "of every kind": {
        "delay_ns": 60 * MS,
        "sample_time_ns": 30 * MS,
        "jitter": Jitter("exponential", mean_ns=150 * MS, max_ns=200 * MS),
        "loss": 0.3,
        "duplicate": 0.4,
        "data_rate": 100_000,
        "frame_size": 103,
    },
}


@pytest.mark.parametrize("name", LINKS)
def test_clocked_link_delivers_as_the_link_of_the_master(tmp_path: Path, name: str) -> None:
    """The receiver has the same messages at every instant, once its events are over."""
    link = PacketLink("Channel", **{"sample_time_ns": 50 * MS, **LINKS[name]})
    spec = VARIABLES.packet_spec("Channel", link, [LinkSignal()])
    channel = build_fmu(spec, tmp_path / "clocked", "native-fmi3", clocked=True)
    assert [f for f in inspect_fmu(channel).findings if f.level == "error"] == []
    ramp = describe_fmu(event_fmu(tmp_path, ["ramp"]))
    sink = describe_fmu(event_fmu(tmp_path, ["x"]))
    end = Endpoint("sink", "x")
    direct = {"ramp": Component(ramp), "sink": Component(sink)}
    through = {**direct, "link": Component(describe_fmu(channel))}
    found = []
    for components, wires, links in (
        (direct, [Connection(Endpoint("ramp", "ramp"), end, "Channel")], {"Channel": link}),
        (
            through,
            [
                Connection(Endpoint("ramp", "ramp"), Endpoint("link", "u[1]")),
                Connection(Endpoint("link", "y[1]"), end),
            ],
            {},
        ),
    ):
        schedule = make_schedule(links, 250 * MS, 4000 * MS, "align")
        with Session(System(components, wires, links, {}, schedule)) as session:
            session.run_until()
            run = session.result(complete=True)
        assert run.status == "finished", run.reason
        found.append((run.points_ns, run.signal("sink", "x")))
    (times, values), (other_times, other_values) = found
    instants = np.unique(times)
    last = np.searchsorted(times, instants, side="right") - 1
    other = np.searchsorted(other_times, instants, side="right") - 1
    # what is sent is the time, which the sender rounds as it steps: the same messages are in use
    np.testing.assert_array_equal(np.rint(other_values[other] * 1e9), np.rint(values[last] * 1e9))
    assert np.unique(values).size > 10
