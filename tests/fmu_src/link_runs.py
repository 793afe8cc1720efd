"""A link FMU under a plain loop of fmpy's, and the same link by `cosim.network`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from raw_fmu import RawFmu

from cosim.fmu import build_fmu
from cosim.fmu.export import component_module
from cosim.network import LinkState, PacketLink, TransportLink, deliver

VARIABLES = component_module("link_channel.variables")
LinkSignal = VARIABLES.LinkSignal

INITIAL = (7.0, -3.0)


def signal(points_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Two signals at the points, (n, 2): no value comes twice."""
    t = points_ns / 1e9
    return np.column_stack([np.sin(t) + t, np.cos(2.3 * t) - 0.5 * t])


def expected(link: PacketLink, step_ns: int, steps: int) -> tuple[NDArray[np.float64], LinkState]:
    """What the receiver has at each point, (steps + 1, 2), and the state of the link."""
    points = np.arange(steps + 1) * step_ns
    delivery = deliver(link, step_ns * steps, step_ns)
    in_use = delivery.sent_in_use(points)
    values = link.quantize(signal(np.maximum(in_use, 0)))
    values[in_use == -1] = INITIAL
    if link.substitute is not None:
        values[in_use == -2] = link.substitute
    return values, delivery.state(points)


def build(link: PacketLink | TransportLink, folder: Path, step_ns: int) -> Path:
    """The link FMU of a link that carries two signals."""
    signals = [LinkSignal("m", INITIAL[0], "one"), LinkSignal(None, INITIAL[1], "two")]
    made = VARIABLES.packet_spec if isinstance(link, PacketLink) else VARIABLES.transport_spec
    return build_fmu(made("Channel", link, signals, step_ns / 1e9), folder, "native")


class Channel(RawFmu):
    """A link FMU that is fed `signal`."""

    def begin(self, parameters: Mapping[str, float] | None = None) -> Channel:
        """Set parameters, an int as an Integer, and initialise."""
        for name, value in (parameters or {}).items():
            write = self.fmu.setInteger if isinstance(value, int) else self.fmu.setReal
            write([self.reference[name]], [value])
        self.initialise()
        return self

    def row(self) -> list[float]:
        """Outputs y; age, sequence, dropped where there are any."""
        whole = [self.reference[n] for n in ("sequence", "dropped") if n in self.reference]
        return self.get("y[1]", "y[2]", "age") + (self.fmu.getInteger(whole) if whole else [])

    def run(self, step_ns: int, first: int, last: int) -> NDArray[np.float64]:
        """Steps first to last - 1; the row after each."""
        sent = signal(np.arange(last) * step_ns)
        rows = []
        for k in range(first, last):
            self.put({"u[1]": sent[k, 0], "u[2]": sent[k, 1]})
            self.step(k * step_ns / 1e9, step_ns / 1e9)
            rows.append(self.row())
        return np.array(rows)
