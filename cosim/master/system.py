"""A system to be run: its parts, checked."""

from __future__ import annotations

from dataclasses import InitVar, dataclass, field
from typing import Any

from cosim.master.checks import check_links, check_parts
from cosim.master.parts import Parts
from cosim.master.structure import same_structure


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
    delays : by link with a `DelaySignal`, the signals that decide its delay; by medium whose nodes
        move, as medium.NAME, the signals that are their places.
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
    modes : the mode machines by name; what conducts the session sets which state one is in
        (`Session.set_event_value`), by its number.

    receiving : what `receiving_order` keeps, once it was asked.
    form : the same object for systems that are known to have the `same_structure`.
    like : a checked system; what it has in common with this one is not checked again.

    Raises
    ------
    InputError : parts that do not fit together.
    """

    receiving: Any = field(default=None, init=False, repr=False, compare=False)
    form: Any = field(default=None, init=False, repr=False, compare=False)
    like: InitVar[System | None] = None

    def __post_init__(self, like: System | None) -> None:
        check_links(self)
        alike = like is not None and same_structure(self, like)
        object.__setattr__(self, "form", like.form if like is not None and alike else object())
        if not alike or self._checks_look_at_points:
            check_parts(self)

    @property
    def _checks_look_at_points(self) -> bool:
        """Whether the checks may find something else in another system of the same structure.

        They look at neither parameters nor the numbers of links, but where they look at points.
        """
        steps_matter = any(
            component.every_ns is not None
            or component.has_events
            or not component.description.variable_step
            for component in self.components.values()
        )
        lengths_matter = not all(callable(signal) for signal in self.driven.values())
        return steps_matter or lengths_matter
