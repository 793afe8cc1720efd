"""A run as a list of calls: what both engines carry out at every point.

    every get of `sends`;  then, per station in order: its moves, its sets, its `answers`;
    is every output in range?  then, unless it is the last point, every step.

Values are exchanged where they lie in the rows: a get of Reals is handed the address in row k
to write to, a set the address to read from, in row k or in the sender's row that the schedule
names. Only what is interpolated, quantized, substituted or not side by side is moved first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master.system import System
from cosim.master.wiring import Group, Route, Rows, Station, Wiring

_TYPES = {"float": "Real", "int": "Integer", "bool": "Boolean"}
WARNING = 1
"""Greatest fmi2Status with which a run goes on: OK is 0, Warning 1."""


@dataclass(frozen=True, eq=False)
class Call:
    """One FMI call that moves a group.

    station : number of the station.
    function, component : addresses.
    references : value references, uint32 (m,).
    column : where the values stand in the rows, or are to be read from.
    scratch : what Integers and Booleans go through, int32 (m,); empty for Reals.
    table : number of the verbatim route whose row is read; -1: row k itself.
    own : where the values stand in the station's own part of row k.
    """

    station: int
    function: int
    component: int
    references: NDArray[np.uint32]
    column: int
    scratch: NDArray[np.int32]
    table: int
    own: int

    @property
    def reals(self) -> bool:
        """Whether it moves Reals, straight from or to the rows."""
        return self.scratch.size == 0


@dataclass(frozen=True)
class Part:
    """What one station does once all have sent."""

    moves: tuple[Route, ...]
    sets: tuple[Call, ...]
    gets: tuple[Call, ...]


class Halt(NamedTuple):
    """Why a run cannot go on.

    k : the point.
    complete : number of rows that are complete.
    what : the FMI call that was refused, "get", "set" or "step"; or "range", where an output
        has left it.
    station : number of the station in the wiring; of a "range", the column of the output.
    status : as the FMU returned it.
    """

    k: int
    complete: int
    what: Literal["get", "set", "step", "range"]
    station: int
    status: int


@dataclass(frozen=True)
class Program:
    """All that happens at a point, with addresses in place of names.

    Attributes
    ----------
    rows, outputs : as in the wiring.
    points_ns, seconds : the points, as integers [ns] and as doubles [s].
    sends : gets of all stations.
    parts : per station, in order of receiving.
    tables : rows in use, by number of the verbatim route.
    steps : (number of the station, fmi2DoStep, component), in order of stepping.
    bound : an output beyond +-bound, or NaN, ends the run.
    """

    rows: Rows
    outputs: int
    points_ns: NDArray[np.int64]
    seconds: NDArray[np.float64]
    sends: tuple[Call, ...]
    parts: tuple[Part, ...]
    tables: tuple[NDArray[np.int64], ...]
    steps: tuple[tuple[int, int, int], ...]
    bound: float


class _Maker:
    """Collects calls and tables."""

    def __init__(self, stations: Sequence[Station]) -> None:
        self.stations = stations
        self.tables: list[NDArray[np.int64]] = []

    def get(self, number: int, group: Group) -> Call:
        return self._call(number, group, "get", group.column, -1)

    def part(self, number: int) -> Part:
        station = self.stations[number]
        moves = [r for i, r in enumerate(station.routes) if i not in station.straight]
        sets = []
        for group in station.takes:
            if group.route not in station.straight:
                sets.append(self._call(number, group, "set", group.column, -1))
                continue
            route = station.routes[group.route]
            wire = bool((route.row == np.arange(route.row.size)).all())
            if not wire:
                self.tables.append(np.ascontiguousarray(route.row))
            table = -1 if wire else len(self.tables) - 1
            sets.append(self._call(number, group, "set", int(route.columns[0]), table))
        gets = tuple(self.get(number, group) for group in station.answers)
        return Part(tuple(moves), tuple(sets), gets)

    def _call(
        self, number: int, group: Group, way: Literal["get", "set"], column: int, table: int
    ) -> Call:
        slave = self.stations[number].slave
        reals = group.kind == "float"
        return Call(
            station=number,
            function=slave.address(way, _TYPES[group.kind]),
            component=slave.component,
            references=group.references,
            column=column,
            scratch=np.zeros(0 if reals else group.references.size, np.int32),
            table=table,
            own=group.column,
        )


def make_program(system: System, wiring: Wiring) -> Program:
    """The program of a wiring whose stations have their slaves."""
    maker = _Maker(wiring.stations)
    numbered = list(enumerate(wiring.stations))
    sends = tuple(maker.get(i, group) for i, station in numbered for group in station.sends)
    parts = tuple(maker.part(i) for i, _ in numbered)
    places = {station.name: i for i, station in numbered}
    slaves = [(places[name], wiring.stations[places[name]].slave) for name in system.components]
    points = system.timetable.points_ns
    return Program(
        rows=wiring.rows,
        outputs=wiring.outputs,
        points_ns=points,
        seconds=points / 1e9,
        sends=sends,
        parts=parts,
        tables=tuple(maker.tables),
        steps=tuple((i, slave.address("step"), slave.component) for i, slave in slaves),
        bound=system.divergence,
    )
