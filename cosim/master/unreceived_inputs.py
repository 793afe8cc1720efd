"""Fill the inputs that components had not received when a run stopped early (Gauss-Seidel).

When a component ends the run at point k, or an output is out of range there, all outputs of row k
are known, but the components after it in the order have not received yet and have no outputs at
the next point. Without this, the row would contain their start values there.
"""

from __future__ import annotations

from cosim.master.plain_loop import move
from cosim.master.table import EarlyStop, Get, Move, Set, Table, When


def fill_unreceived_inputs(table: Table, early_stop: EarlyStop) -> None:
    """Set the missing inputs of row k: from stepped components, else from the outputs in row k."""
    k = early_stop.k
    place, number = table.place()
    if place != k or early_stop.complete <= k:
        return
    stopped = table.operations[number].instance
    left = [
        operation
        for operation in table.operations[table.complete + 1 :]
        if operation.instance >= stopped
        and (operation.following is None or operation.following[k] >= 0)
    ]
    for operation in left:
        if isinstance(operation, Get) and operation.ahead and k != table.comm_points.final:
            following = k + 1 if operation.following is None else int(operation.following[k])
            columns = slice(operation.group.column, operation.group.column + operation.group.size)
            table.rows[following, columns] = table.rows[k, columns]
    for operation in left:
        if operation.instance == stopped or operation.when is not When.ALWAYS:
            continue
        if isinstance(operation, Move):
            move(table, operation, k, k)
        elif isinstance(operation, Set):
            table.adjust(operation.group, k)
