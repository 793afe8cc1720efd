"""A run as it stands, to go on from: states of all slaves, rows, what is overridden."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cosim.errors import InputError
from cosim.master.engine import Adjustment
from cosim.master.stations import Rows
from cosim.master.system import System
from cosim.master.wiring import Wiring


def fingerprint(system: System, wiring: Wiring) -> str:
    """What two sessions must have in common to share a snapshot."""
    digest = hashlib.sha256(system.timetable.points_ns.tobytes())
    digest.update(system.algorithm.encode())
    for name, component in system.components.items():
        digest.update(f"{name}\0{component.description.sha256}\0{component.every_ns}\0".encode())
    for station in wiring.stations:
        for column in (*station.output_columns, *station.input_columns):
            digest.update(f"{station.name}.{column.name}\0".encode())
        for route in station.routes:
            digest.update(route.row.tobytes())
    return digest.hexdigest()


@dataclass(frozen=True)
class Snapshot:
    """What `Session.snapshot` gives.

    Attributes
    ----------
    system : fingerprint of the system it belongs to.
    complete : number of complete rows.
    rows : those rows, and the one after them as far as it is there.
    states : per component.
    adjustments : by column.
    """

    system: str
    complete: int
    rows: Rows
    texts: Sequence[str]
    states: Mapping[str, Any]
    adjustments: Mapping[int, Adjustment]

    @classmethod
    def take(
        cls, system: str, wiring: Wiring, complete: int, adjustments: Mapping[int, Adjustment]
    ) -> Snapshot:
        """Save the state of every slave."""
        for station in wiring.stations:
            station.inputs(complete)
        return cls(
            system,
            complete,
            wiring.rows[: complete + 1].copy(),
            wiring.texts.all(),
            {station.name: station.slave.snapshot() for station in wiring.stations},
            adjustments,
        )

    def check(self, system: str) -> None:
        """Refuse a snapshot of another system."""
        if self.system != system:
            raise InputError(
                "the snapshot is of another system",
                where="Session.restore",
                expected="the same FMUs, connections, links, steps and end",
            )

    def put_back(self, system: System, wiring: Wiring) -> None:
        """Restore every slave, and the rows."""
        wiring.texts.learn(self.texts)
        for station in wiring.stations:
            station.slave.restore(self.states[station.name])
            station.forget(self.complete)
        wiring.rows[: self.rows.shape[0]] = self.rows
        wiring.begin_again(system, self.complete + 1)
