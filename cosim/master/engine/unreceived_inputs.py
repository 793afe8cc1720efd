"""Fill the inputs that components had not received when a run stopped early (Gauss-Seidel).

When a component ends the run at point k, all outputs of row k are known, but the components after
it in the order have not received yet and have no outputs at the next point. Without this, the
row would contain zeros there.
"""

from __future__ import annotations

from collections.abc import Sequence

from cosim.master.component_instance import ComponentInstance
from cosim.master.engine.generated_code import mover
from cosim.master.engine.program import Adjust, EarlyStop, Move, Program


def fill_unreceived_inputs(
    program: Program, instances: Sequence[ComponentInstance], early_stop: EarlyStop
) -> None:
    """Set the missing inputs of row k: from stepped components, else from the outputs in row k."""
    k, last = early_stop.k, early_stop.k == program.comm_points.final
    for number in range(early_stop.instance, len(instances)):
        own, next_points = instances[number], program.next_points[number]
        following = k + 1 if next_points is None else int(next_points[k])
        if not last and following > k:
            own.outputs[following] = own.outputs[k]
    for operation in program.concluding if last else program.leaving:
        if operation.instance <= early_stop.instance:
            continue
        next_points = program.next_points[operation.instance]
        if next_points is not None and next_points[k] < 0:
            continue
        if isinstance(operation, Move):
            mover(program, operation.route)(k)
        elif isinstance(operation, Adjust) and not operation.ahead:
            operation.by.apply(program.rows, k, operation.column)
