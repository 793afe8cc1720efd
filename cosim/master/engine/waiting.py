"""What a component would have received whose turn did not come any more (Gauss-Seidel).

When a component ends the run in its turn at point k, the outputs of row k are all known, but
those after it in the order have not received yet, and nobody has reached the next point who was
to do so after it. A reader of the row shall not find zeros there.
"""

from __future__ import annotations

from collections.abc import Sequence

from cosim.master.engine.listing import mover
from cosim.master.engine.program import Adjust, Halt, Move, Program
from cosim.master.stations import Station


def fill_in(program: Program, stations: Sequence[Station], halt: Halt) -> None:
    """Complete the inputs of row k: from who has stepped, else from what is in row k."""
    k, last = halt.k, halt.k == program.course.final
    for number in range(halt.station, len(stations)):
        own, beat = stations[number], program.beats[number]
        following = k + 1 if beat is None else int(beat[k])
        if not last and following > k:
            own.outputs[following] = own.outputs[k]
    for operation in program.concluding if last else program.leaving:
        if operation.station <= halt.station:
            continue
        beat = program.beats[operation.station]
        if beat is not None and beat[k] < 0:
            continue
        if isinstance(operation, Move):
            mover(program, operation.route)(k)
        elif isinstance(operation, Adjust) and not operation.ahead:
            operation.by.put_on(program.rows, k, operation.column)
