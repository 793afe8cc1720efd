"""The law of the loop's connections: what an input has is what its sender had, unaltered."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from cosim.master import ComponentInstance, Connection, Route
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.first_departure import first_departed
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.signal_reader import Block, own_points

_CLOSE = 1e-12


@measure
def delivery_law(
    run: MeasuredRun, connections: Iterable[Connection], *, altered: bool = True
) -> Fold[list[Departure]]:
    """Measure where an input first had a value that its sender did not have: once for each route.

    Connections through a link that interpolates have the value in between. What is not yet
    delivered, or replaced by a link's substitute, is a matter of ages.

    Parameters
    ----------
    connections : of the loop.
    altered : whether values may be overridden on their way. Otherwise what a route brings verbatim
        is the sender's value by construction: rows have it by a copy.
    """
    run.reads_inputs = True
    targets = {(c.target.component, c.target.variable) for c in connections}
    compared: dict[Route, tuple[ComponentInstance, list[int], list[str]]] = {}
    for receiver in run.instances.values():
        first, columns = receiver.input_column, receiver.input_columns
        for route in receiver.routes if altered else _not_verbatim(receiver):
            into = [columns[target - first] for target in route.targets.tolist()]
            chosen = [
                k
                for k, column in enumerate(into)
                if not targets.isdisjoint(
                    (receiver.name, n) for n in (column.name, column.port.name)
                )
            ]
            if chosen:
                compared[route] = receiver, chosen, [into[k].name for k in chosen]
    departures: dict[Route, list[Departure]] = {route: [] for route in compared}
    while block := (yield):
        for route, (receiver, chosen, names) in compared.items():
            if not departures[route]:
                departures[route] = _compared(receiver, route, chosen, names, block)
    return [each for departure in departures.values() for each in departure]


def _not_verbatim(receiver: ComponentInstance) -> list[Route]:
    return [route for route in receiver.routes if not route.verbatim]


def _compared(
    receiver: ComponentInstance,
    route: Route,
    chosen: Sequence[int],
    names: Sequence[str],
    block: Block,
) -> list[Departure]:
    """Compare inputs of one route; return where one was first another, or nothing.

    A row that is not complete yet is compared in the next block.
    """
    rows, used = receiver.rows, route.in_step
    own = own_points(receiver, block)
    own = own[(used.row[own] >= 0) & (used.row[own] < block.last)]
    own = own[own > 0] if used.initialised else own
    columns = route.columns[chosen]
    if used.weight is None or used.after is None:
        sent = rows[used.row[own][:, None], columns]
    else:
        own = own[used.after[own] < block.last]
        share = used.weight[own][:, None]
        sent = (1 - share) * rows[used.row[own][:, None], columns]
        sent += share * rows[used.after[own][:, None], columns]
    got = rows[own[:, None], route.targets[chosen]]
    apart = ~(np.abs(sent - got) <= _CLOSE * np.abs(sent)) & ~(np.isnan(sent) & np.isnan(got))
    times = receiver.comm_points.points_ns[own]
    return first_departed(receiver, names, times, (sent, got), apart, f"as {route.source} sent it")
