"""A run that goes on as far as it is told: what `open_session` returns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, Self

from cosim.core import Seconds, seconds
from cosim.master import Pace, Run, RunStatus, Snapshot, System
from cosim.network import LinkState
from cosim.scenario.scenario_session import ScenarioSession
from cosim.scenario.supervised_session import SupervisedSession
from cosim.trace.outcome import Cause


class Session:
    """A scenario, run call by call; its signals are read and replaced by their names.

        >>> from cosim import DelaySystem, Scenario, open_session
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> with open_session(tank) as session:
        ...     stopped = session.run(1.0)
        ...     before, low = session.save(), session["tank.x[1]"]
        ...     while not session.ended:
        ...         session["tank.u"] = [2.0 - session["tank.x[1]"]]
        ...         session.step()
        ...     filled = session["tank.x[1]"] > low
        ...     session.restore(before)
        ...     filled, session["tank.x[1]"] == low, session.time, session.status
        (True, True, 1.0, 'running')

    A group, `plant.x`, is an array. The components are always at `time`, and so are their outputs;
    inputs are those of the step before, until the run goes on.

    It is open until its `with` block ends. When the run is over, the session has ended: a step is
    then refused, but `restore` goes back. A component that fails ends the session for good: that
    call, and every later one, raises its `ComponentError`.

    Attributes
    ----------
    system : components, connections and links.
    """

    def __init__(self, session: ScenarioSession | SupervisedSession) -> None:
        self._session = session
        self.system: System = session.system

    def __repr__(self) -> str:
        return f"<Session: {self.status or 'not open'} at {self.time:g} s, {self.rows} rows>"

    def close(self) -> None:
        """End the components; the end of the `with` block does the same."""
        self._session.close()

    def __getitem__(self, name: str) -> Any:
        """Return the present value of a variable, `plant.x[1]`; of a group an array of doubles.

        Raises
        ------
        InputError : no such component or variable.
        """
        return self._session[name]

    def __setitem__(self, name: str, value: Any) -> None:
        """Set an input or a tunable parameter, or each of a group from a sequence.

        An output, or an input that is connected, has this value until it is released.

        Raises
        ------
        InputError : a variable that cannot be set now, or a sequence of another length.
        """
        self._session[name] = value

    def members(self, name: str) -> list[str]:
        """Return the names of the variables of a group, or the one of this name.

        Raises
        ------
        InputError : no such component or variable.
        """
        return [f"{component}.{variable}" for component, variable in self._places(name)]

    def bias(self, name: str, offset: float, factor: float = 1.0) -> None:
        """Replace an output or connected input by factor * value + offset, until released."""
        for component, variable in self._places(name):
            self._session.bias(component, variable, offset, factor)

    def release(self, name: str) -> None:
        """Let an output or connected input, or those of a group, have their own values again."""
        for component, variable in self._places(name):
            self._session.release(component, variable)

    def step(self, points: int = 1) -> None:
        """Go on by so many communication points, or to the end.

        Raises
        ------
        ComponentError : the run fails here, or has failed.
        InputError : it has ended, or the session is not open.
        """
        self._session.step(points)

    def run(
        self,
        until: Seconds | None = None,
        *,
        stop: Callable[[Self], bool] | None = None,
        pace: Pace | None = None,
    ) -> bool:
        """Go on to the first point at or after a time, or to the end; return whether `stop` did.

        Parameters
        ----------
        until : time [s], or a text with a unit; None: the end.
        stop : called with this session after every row; a true result ends the call, not the run.
        pace : slows the run down to wall-clock time.

        Raises
        ------
        ComponentError, InputError : as `step`.
        """
        end = None if until is None else seconds(until, "until")
        look = None if stop is None else (lambda _: stop(self))
        return self._session.run_until(end, stop=look, pace=pace)

    def save(self, *, portable: bool = False) -> Snapshot:
        """Return the present state: components, links, rows, and replaced values.

        portable : as bytes, for `Snapshot.save` and for other sessions of the same scenario.

        Raises
        ------
        InputError : a component that cannot save its state, named.
        """
        return self._session.snapshot(portable=portable)

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a state, bit for bit; also from the end of the run.

        Raises
        ------
        InputError : one of another scenario, or of another session and not portable; an observer,
            such as a trace, that has received rows which would be computed anew.
        ComponentError : the run has failed.
        """
        self._session.restore(snapshot)

    def reset(self, component: str) -> None:
        """Reset one component to its start values and parameters, at the present time.

        Raises
        ------
        ComponentError : its FMU cannot be reset.
        """
        self._session.reset(component)

    def link_state(self, link: str) -> LinkState:
        """Return the state of a packet link at the last complete row, arrays of shape (1,)."""
        return self._session.link_state(link)

    def note(self, level: str, message: str) -> None:
        """Write a line to the log of the run: "info", "warning", ..., at the present time."""
        self._session.check_not_failed()
        self._session.note(level, "session", message)

    def result(self, *, complete: bool = False) -> Run:
        """Return the run so far, with rows of its own; "stopped" if it has not ended by itself.

        complete : without the values at `time`, which are complete when the run goes on.
        """
        return self._session.result(complete=complete)

    @property
    def time(self) -> float:
        """The time of the components [s]."""
        return self._session.time_s

    @property
    def rows(self) -> int:
        """The number of complete rows."""
        return self._session.rows

    @property
    def status(self) -> RunStatus | Literal["running"] | None:
        """How the run stands: "running", or why it ended: "finished", "stopped", "failed", ..."""
        return self._session.status

    @property
    def reason(self) -> str | None:
        """Why the run ended early, in words; None if it did not."""
        return self._session.reason

    @property
    def cause(self) -> Cause | None:
        """The component, call and time of a failure; None without one."""
        return self._session.cause

    @property
    def ended(self) -> bool:
        """Whether the run is at its end or cannot go on."""
        return self._session.ended

    @property
    def end_reason(self) -> str:
        """Why the run does not go on, in words."""
        return self._session.end_reason

    def _places(self, name: str) -> list[tuple[str, str]]:
        signals = self._session.named(name)
        return [(signals.component, one) for one in signals.members]
