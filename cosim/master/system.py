"""A system to be run: its parts, checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from cosim.master.checks import check_links, check_parts
from cosim.master.parts import Parts


@dataclass(frozen=True)
class System(Parts):
    """A complete and checked description of one run.

    Attributes
    ----------
    components : by name, in the order in which they are stepped.
    connections : one per input at most; a source may be the state of a packet link.
    links : by name.
    driven : inputs that follow a given signal; a function where points are added during the
        run (a link with a `DelaySignal`, events = "align").
    comm_schedule : communication points and schedules, from `make_schedule`.
    threads : under Jacobi, on so many the components step side by side; worth it where steps take
        far more than 10 microseconds. The rows are the same, bit for bit.
    delays : by link with a `DelaySignal`, the signals that decide its delay.
    divergence : the run counts as diverged when the magnitude of an output exceeds this; None:
        when it exceeds a million times the nominal value that its FMU declares, if it declares one.
    algorithm : "jacobi": all components step on the values of the same point; "gauss-seidel":
        one after the other, each on the new outputs of those before it.
    order : of all components under Gauss-Seidel; None: senders before receivers with direct
        feedthrough, else as in `components`.
    unknown_feedthrough : algebraic loops through outputs that do not declare their dependencies:
        "refuse" them, or delay connections of the loop by one step, "previous"
        (`cosim.master.order`).
    solve : solve algebraic loops at every communication point, by iteration to a fixed point.
    solve_tolerance : largest change of an input of a solved loop in its last iteration, relative
        to the greater of its magnitude and 1.
    solve_limit : most iterations of a loop at one point.

    receiving : what `receiving_order` keeps, once it was asked.

    Raises
    ------
    InputError : parts that do not fit together.
    """

    receiving: Any = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        check_links(self)
        check_parts(self)
