"""Snapshots of a run, to continue from: states of all slaves, rows, overrides."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from cosim.core import AnyPath, InputError, not_written, written_beside
from cosim.fmu import FmuState
from cosim.master.adjustments import Adjustment
from cosim.master.component_instance import Rows
from cosim.master.system import System
from cosim.master.wiring import Wiring
from cosim.network import DelayProfile


def fingerprint(system: System, wiring: Wiring) -> str:
    """Hash what two sessions must have in common to share a snapshot."""
    schedule = system.comm_schedule
    digest = hashlib.sha256(f"{schedule.step_ns}\0{schedule.end_ns}\0{schedule.events}\0".encode())
    if schedule.start_ns:
        digest.update(f"from {schedule.start_ns}\0".encode())
    for instants in (schedule.instants_ns, schedule.given_ns, np.array(schedule.every_ns)):
        digest.update(b"\0" if instants is None else instants.tobytes() + b"\0")
    digest.update(system.algorithm.encode())
    for name, component in system.components.items():
        digest.update(f"{name}\0{component.description.sha256}\0{component.every_ns}\0".encode())
    for instance in wiring.instances:
        for column in (*instance.output_columns, *instance.input_columns):
            digest.update(f"{instance.name}.{column.name}\0".encode())
        for route in instance.routes:
            digest.update(f"{route.route_key}\0{route.columns.tolist()}\0".encode())
    for name, link in system.links.items():
        digest.update(f"{name}\0{link!r}\0".encode())
        if isinstance(link.delay, DelayProfile):  # its repr is abridged
            digest.update(link.delay.times_ns.tobytes() + link.delay.delays_ns.tobytes())
        if name in system.delays:  # its points and delays depend on the run
            digest.update(f"{system.delays[name]!r}\0".encode())
    media = {name: found for name, found in system.delays.items() if name not in system.links}
    digest.update(f"{media!r}".encode() * bool(media))
    return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of a run, as `Session.save` returns it.

        >>> from cosim import DelaySystem, Scenario, open_session
        >>> from cosim.master import Snapshot
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> with open_session(lag) as session:
        ...     session.step(5)
        ...     session.save(portable=True).save("half.npz")
        >>> with open_session(lag) as session:
        ...     session.restore(Snapshot.load("half.npz"))
        ...     session.time
        0.5

    Attributes
    ----------
    system : fingerprint of the system it belongs to.
    complete : number of complete rows.
    rows : those rows, and the one after them as far as it is computed.
    texts : the strings of the run, by the numbers in the rows.
    states : by component: a state of this session's slave, or, portable, bytes.
    adjustments : overrides and biases, by column.
    values : as in `CommunicationPoints`.
    event_values : what events have set (`EventValues.all`).
    events : state of what executes events in the session; JSON-safe.
    """

    system: str
    complete: int
    rows: Rows
    texts: Sequence[str]
    states: Mapping[str, FmuState | bytes]
    adjustments: Mapping[int, Adjustment]
    values: Mapping[str, Sequence[Any]]
    event_values: Mapping[str, Sequence[Sequence[float]]] = field(default_factory=dict)
    events: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def take(
        cls,
        system: str,
        wiring: Wiring,
        complete: int,
        adjustments: Mapping[int, Adjustment],
        *,
        portable: bool,
    ) -> Snapshot:
        """Save the state of every slave, and the rows."""
        wiring.make_whole(complete)
        states: dict[str, FmuState | bytes] = {}
        for instance in wiring.instances:
            state = instance.slave.snapshot()
            states[instance.name] = state
            if portable:
                states[instance.name] = instance.slave.serialise(state)
                instance.slave.free(state)
        rows = wiring.rows[: complete + 1].copy()
        values = {name: tuple(given) for name, given in wiring.comm_points.values.items()}
        set_values = wiring.comm_points.event_values.all()
        return cls(
            system, complete, rows, wiring.texts.all(), states, adjustments, values, set_values
        )

    def check(self, system: str) -> None:
        """Refuse a snapshot of another system."""
        if self.system != system:
            raise InputError(
                "the snapshot is of another system",
                where="Session.restore",
                expected="the same FMUs, connections, links, steps and end",
            )

    def restore_into(self, wiring: Wiring) -> None:
        """Restore the state of every slave, and the rows."""
        wiring.texts.restore(self.texts)
        for instance in wiring.instances:
            saved = self.states[instance.name]
            if isinstance(saved, bytes):
                state = instance.slave.deserialise(saved)
                instance.slave.restore(state)
                instance.slave.free(state)
            else:
                instance.slave.restore(saved)
        wiring.comm_points.go_back(self.values, self.event_values, self.complete)
        wiring.begin()
        wiring.rows[: self.rows.shape[0], : wiring.outputs] = self.rows[:, : wiring.outputs]
        wiring.rows[: self.complete] = self.rows[: self.complete]
        wiring.whole_rows = self.complete

    def save(self, path: AnyPath) -> None:
        """Write a portable snapshot to a file (NumPy's .npz).

        Raises
        ------
        InputError : it is not portable, or the file cannot be written.
        """
        target = Path(path)
        if not all(isinstance(state, bytes) for state in self.states.values()):
            raise InputError(
                "this snapshot is bound to its session",
                where=str(path),
                hint="take it with session.save(portable=True)",
            )
        about = {
            "system": self.system,
            "complete": self.complete,
            "texts": list(self.texts),
            "components": list(self.states),
            "values": {name: list(given) for name, given in self.values.items()},
            "event_values": dict(self.event_values),
            "adjustments": {str(c): list(a) for c, a in self.adjustments.items()},
            "events": self.events,
        }
        states: dict[str, Any] = {
            f"state{i}": np.frombuffer(cast("bytes", state), np.uint8)
            for i, state in enumerate(self.states.values())
        }
        with (
            not_written("the snapshot", target),
            written_beside(target) as partial,
            partial.open("wb") as stream,
        ):
            np.savez(stream, about=np.array(json.dumps(about)), rows=self.rows, **states)

    @classmethod
    def load(cls, path: AnyPath) -> Snapshot:
        """Read what `save` wrote.

        Raises
        ------
        InputError : no such file, or not a snapshot.
        """
        try:
            with np.load(path, allow_pickle=False) as found:
                about = json.loads(str(found["about"]))
                states = {
                    name: found[f"state{i}"].tobytes() for i, name in enumerate(about["components"])
                }
                rows = found["rows"]
            adjustments = {int(c): Adjustment(*a) for c, a in about["adjustments"].items()}
            return cls(
                about["system"],
                about["complete"],
                rows,
                about["texts"],
                states,
                adjustments,
                about["values"],
                about.get("event_values", {}),
                about.get("events", {}),
            )
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
            raise InputError(
                "not a snapshot",
                where=str(path),
                expected="a file that Snapshot.save wrote",
                got=str(error),
            ) from error
