"""The law of the loop's connections: what an input has is what its sender had, unaltered."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.master import ComponentInstance, Connection, Route, Run
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.measure import Measure

_CLOSE = 1e-12


class DeliveryLaw(Measure[list[Departure]]):
    """Where an input of the loop had, for the first time, a value that its sender did not have.

    Connections through a link that interpolates have the value in between. What is not yet
    delivered, or replaced by a link's substitute, is a matter of ages.

    Parameters
    ----------
    connections : of the loop.
    altered : whether values may be overridden on their way. Otherwise what a route brings verbatim
        is the sender's value by construction: rows have it by a copy.
    """

    def __init__(self, connections: Iterable[Connection], *, altered: bool = True) -> None:
        self._altered = altered
        self._wanted: Mapping[str, set[str]] = {}
        wanted: dict[str, set[str]] = {}
        for c in connections:
            wanted.setdefault(c.target.component, set()).add(c.target.variable)
        self._wanted = wanted
        self._routes: list[_Delivered] = []
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find the columns."""
        for receiver in instances:
            names = self._wanted.get(receiver.name)
            if not names:
                continue
            first = receiver.input_column
            mine = {
                first + j: column.name
                for j, column in enumerate(receiver.input_columns)
                if column.name in names or column.port.name in names
            }
            for route in receiver.routes:
                chosen = [k for k, target in enumerate(route.targets.tolist()) if target in mine]
                if chosen and (self._altered or not route.verbatim):
                    measured = [f"{receiver.name}.{mine[int(route.targets[k])]}" for k in chosen]
                    self._routes.append(_Delivered(receiver, route, np.array(chosen), measured))

    def add(self, first: int, last: int) -> None:
        """Compare at the points."""
        for route in self._routes:
            route.add(first, last)

    def result(self, run: Run) -> list[Departure]:
        """Return the departures, one for each route at most."""
        del run
        return [route.found for route in self._routes if route.found is not None]


class _Delivered:
    """The inputs that come by one route."""

    def __init__(
        self,
        receiver: ComponentInstance,
        route: Route,
        chosen: NDArray[np.intp],
        names: Sequence[str],
    ) -> None:
        self._receiver, self._route, self._names = receiver, route, names
        self._from, self._to = route.columns[chosen], route.targets[chosen]
        self._awaited: NDArray[np.float64] | None = None
        self.found: Departure | None = None

    def add(self, first: int, last: int) -> None:
        """Compare; a row that is not complete yet is compared in the next block."""
        if self.found is not None:
            return
        own = self._receiver.own_points.own_between(first, last)
        rows, used = self._receiver.rows, self._route.in_step
        if self._awaited is not None:
            sent = rows[first, self._from]
            self._compare(sent[None], self._awaited[None], np.array([max(first - 1, 0)]))
            self._awaited = None
        own = own[own > 0] if used.initialised else own
        row = used.row[own]
        if row.size and row[-1] >= last:
            self._awaited = rows[own[-1], self._to].copy()
        there = (row >= 0) & (row < last)
        own, row = own[there], row[there]
        if not own.size:
            return
        sent = rows[row[:, None], self._from]
        if used.weight is not None and used.after is not None:
            later, weight = used.after[own], used.weight[own]
            known = later < last
            own, sent, later, weight = own[known], sent[known], later[known], weight[known]
            sent = (1 - weight)[:, None] * sent + weight[:, None] * rows[later[:, None], self._from]
        self._compare(sent, rows[own[:, None], self._to], own)

    def _compare(
        self, sent: NDArray[np.float64], got: NDArray[np.float64], own: NDArray[np.int64]
    ) -> None:
        apart = ~(np.abs(sent - got) <= _CLOSE * np.abs(sent)) & ~(np.isnan(sent) & np.isnan(got))
        if self.found is not None or not apart.any():
            return
        k, j = (int(x) for x in np.argwhere(apart)[0])
        at = self._receiver.comm_points.at_s(int(self._receiver.comm_points.points_ns[own[k]]))
        source = self._route.source
        expected = f"{sent[k, j]:.9g}, as {source} sent it"
        self.found = Departure(self._names[j], expected, f"{got[k, j]:.9g}", at)
