"""One running FMU slave, of FMI 1.0, 2.0 or 3.0.

Life cycle, each step once and in this order:

    FmuSlave(...)  ->  set_start  ->  enter_initialisation  ->  exit_initialisation
                   ->  step ...   ->  close

`initialise` does the three in the middle. `write` is allowed from the start and `read` from
`enter_initialisation` on, if the standard allows it for the variable. After an error only `close`
is allowed. `close` terminates and frees the slave; it may be called at any time, repeatedly.

An FMI 3 slave is offered event mode (`cosim.fmu.event_mode`), early return and the reading of
outputs within steps as its `SlaveOptions` say; without them it runs by steps alone.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, Self

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2LastSuccessfulTime, fmi2Terminated

from cosim.core import ComponentError
from cosim.fmu.binary import ACCEPTED_STATUSES, NO_OPTIONS, IntermediateValues, SlaveOptions
from cosim.fmu.description import FmuDescription
from cosim.fmu.event_mode import EventAccess
from cosim.fmu.instance import DISCARD
from cosim.fmu.messages import LogSink
from cosim.fmu.returned import within

if TYPE_CHECKING:
    from cosim.fmu.isolation import SlaveProcess

_NS: Final = 1e9
"""Times that are equal in whole nanoseconds, the master's unit, are the same."""


class StepResults(ctypes.Structure):
    """The results of fmi3DoStep: three C bools at 0, 1 and 2, a double at 8; 16 bytes."""

    _fields_ = (
        ("event_handling_needed", ctypes.c_bool),
        ("terminate_simulation", ctypes.c_bool),
        ("early_return", ctypes.c_bool),
        ("last_successful_time", ctypes.c_double),
    )


class FmuSlave(EventAccess):
    """A running slave; see the module for its life cycle.

        >>> from cosim import DelaySystem, pack
        >>> from cosim.fmu import FmuSlave, describe_fmu
        >>> lag = describe_fmu(pack(DelaySystem([[-1]], [[1]]), "lag.fmu"))
        >>> with FmuSlave(lag, "lag", log=print) as slave:
        ...     slave.initialise({"initial.x[1]": 1.0}, 0.0, 10.0)
        ...     slave.write({"u[1]": 1.0})
        ...     slave.step(0.0, 0.1)
        ...     slave.read(["x[1]"])
        {'x[1]': 1.0}

    Parameters
    ----------
    name : name of the component, used in every message.
    log : receives the FMU's messages.
    categories : of the log messages wanted, as the FMU declares them; None: all. Messages with a
        status beyond Warning are always passed on.
    process : the process in which the slave is isolated; None: this process.
    options : the features that the slave is offered, in FMI 3.

    Raises
    ------
    InputError : a second instance of an FMU that allows one, an unknown log category, a file
        that cannot be unpacked.
    ComponentError : no library for this machine, one that does not load, or a refusal.
    """

    def __init__(
        self,
        description: FmuDescription,
        name: str,
        log: LogSink,
        *,
        categories: Sequence[str] | None = None,
        process: SlaveProcess | None = None,
        options: SlaveOptions = NO_OPTIONS,
    ) -> None:
        super().__init__(
            description, name, log, categories=categories, process=process, options=options
        )
        self._results = StepResults()
        self._stop: float | None = None
        self._asked = False

    def initialise(self, parameters: Mapping[str, Any], start: float, stop: float | None) -> None:
        """Set start values and pass through initialization mode, from `start` to `stop` [s].

        Raises
        ------
        InputError, ComponentError : as `set_start` and `exit_initialisation`.
        """
        self.set_start(parameters)
        self.enter_initialisation(start, stop)
        self.exit_initialisation()

    def reset(self) -> None:
        """Return to the state after instantiation.

        Raises
        ------
        ComponentError : the slave refuses, or has no such function.
        """
        self._do("a reset", "reset")
        self.phase = "instantiated"

    def enter_initialisation(self, start: float, stop: float | None) -> None:
        """Enter initialization mode of a run from `start` to `stop` [s]; None: no end."""
        times: tuple[float | None, ...] = (None, start, stop)  # no tolerance
        if self.version == "2.0":
            self._do("setting up the experiment", "setupExperiment", *times)
            times = ()
        self._do("entering the initialisation", "enterInitializationMode", *times)
        self._stop = stop
        self.phase = "initialising"

    def exit_initialisation(self) -> None:
        """Leave initialization mode: the slave is ready to step.

        Raises
        ------
        InputError : the slave does not start with a start value that it was given.
        ComponentError : the slave refuses or has logged an error, the only way some exporters have.
        """
        self._do("the initialisation", "exitInitializationMode")
        if self._logged_error is not None:
            self.phase = "failed"
            raise ComponentError(
                "the initialisation failed", where=self._where, got=self._logged_error
            )
        self.phase = "stepping"
        self.in_event_mode = self.options.event_mode
        self._check_taken()

    def step(self, time: float, size: float) -> None:
        """Advance from `time` by `size` [s]; `asked_to_end` tells whether the slave wants to stop.

        Raises
        ------
        ComponentError : the slave cannot compute the step.
        """
        self._logged_error = None
        status = 0
        try:
            results = self._attempt("doStep", time, size, not self._states)
        except FMICallException as error:
            status, results = error.status, None
        if results is not None:  # FMI 3.0
            for (name, _), value in zip(StepResults._fields_, results, strict=True):
                setattr(self._results, name, value)
        self.early_end(time, time + size, status)

    def early_end(self, time: float, end: float, status: int) -> str | None:
        """Judge a step from `time` to `end` [s] by its status and, in FMI 3, `step_results`.

        Return None if the step is done and the run can continue, and the reason in words if the
        slave ends the run properly. Whoever calls fmiNDoStep at its address calls this after a
        status that is not accepted, or if terminateSimulation or earlyReturn is true.

        FMI 2.0.4 (4.2.2): fmi2Discard means that the slave has computed only a part of the step;
        the master asks fmi2GetRealStatus(fmi2LastSuccessfulTime) for the end of that part, and
        fmi2GetBooleanStatus(fmi2Terminated) whether the slave wants to end the simulation. If it
        does, or if the part ends at the end of the run, nothing is wrong. Else the master should
        repeat the step with a smaller size, if it can: here the step has failed. So it has after
        a logged error, and with PythonFMU, which reports every failed step as such a wish.
        fmi2Pending is a failure: the callback stepFinished, which would allow it, is not given.
        FMI 1.0 (co-simulation, 3.4) is the same without the wish for the end.

        FMI 3.0 (4.2.1): terminateSimulation ends the run at lastSuccessfulTime; earlyReturn is
        forbidden without earlyReturnAllowed.

        Raises
        ------
        ComponentError : the slave has failed.
        """
        self._asked = False
        what, detail = f"step from t = {time:g} s", ""
        wish = f"component {self.name!r} asked for the end in the {what}"
        if status in ACCEPTED_STATUSES:
            if self.version != "3.0":
                return None
            last = self._results.last_successful_time
            self._asked = bool(self._results.terminate_simulation)
            if self._asked:
                return wish + _unless_whole(last, time, end)
            if self._results.early_return and not self.options.early_return:
                self.phase = "failed"
                raise ComponentError(
                    f"{what} ended early, which was not allowed",
                    where=self._where,
                    got=f"t = {last:g} s",
                )
            return None
        if self.version != "3.0" and status == DISCARD:
            reached = self._status_of_step("getRealStatus", fmi2LastSuccessfulTime)
            if self._logged_error is None and not self._of_pythonfmu:
                asks = self.version == "2.0"  # FMI 1.0 has no such wish
                self._asked = asks and bool(
                    self._status_of_step("getBooleanStatus", fmi2Terminated)
                )
                if self._asked:
                    return wish + _unless_whole(reached, time, end)
                if reached is not None and _same(within(reached, time, end), self._stop):
                    self._asked = True
                    return f"component {self.name!r} discarded the {what} at the end of the run"
            if reached is not None:
                detail = f", having {_computed_until(reached, time, end)}"
        raise self.refused(what, status, detail)

    @property
    def results(self) -> StepResults:
        """The results of the last step, in FMI 3."""
        return self._results

    @property
    def step_results(self) -> int:
        """Address of the four out-arguments of fmi3DoStep, laid out as `StepResults`."""
        return ctypes.addressof(self._results)

    def time_reached(self, begin: float, end: float) -> float:
        """Return where the last step, from `begin` to `end` [s], returned early, in FMI 3.

        Raises
        ------
        ComponentError : at no time of the step.
        """
        last = self._results.last_successful_time
        return self._returned("fmi3DoStep").time_reached(last, begin, end)

    def taken_within_steps(self, begin: float, end: float) -> list[IntermediateValues]:
        """Return the outputs read within the last steps, from `begin` to `end`, with times [s].

        Raises
        ------
        ComponentError : values for a time that is not in the steps.
        """
        found: list[IntermediateValues] = self._do("values within steps", "taken")
        judge = self._returned("fmi3DoStep")
        times = judge.times_within((time for time, _ in found), begin, end)
        return list(zip(times, (values for _, values in found), strict=True))

    def forget_within_steps(self) -> None:
        """Forget the outputs read within the last step: it is taken back."""
        self._do("values within steps", "taken")

    def note_wish_to_end(self, time: float) -> None:
        """Note that the slave asked for the end in an event at `time` [s], as if in a step."""
        self._results.terminate_simulation, self._results.last_successful_time = True, time

    def asked_to_end(self) -> bool:
        """Whether the slave ended the run with the last step, as `early_end` found."""
        return self._asked

    def _status_of_step(self, method: str, kind: int) -> Any:
        """Return what a slave says of its discarded step; None if it does not say."""
        error = self.last_error
        try:
            return self._attempt(method, kind)
        except (FMICallException, ComponentError):  # refused, or no such function
            return None
        finally:
            self.last_error = error  # keep the error of the step

    def close(self) -> None:
        """Terminate and free, once."""
        if self.phase != "closed":
            self._free_all()
            self.end(terminate=self.phase == "stepping")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _same(time: float | None, other: float | None) -> bool:
    """Whether two known times are the same."""
    return time is not None and other is not None and round(time * _NS) == round(other * _NS)


def _unless_whole(reached: float | None, begin: float, end: float) -> str:
    """Say until when a step was computed, if that is known and not its end."""
    whole = reached is None or _same(within(reached, begin, end), end)
    return "" if reached is None or whole else f", {_computed_until(reached, begin, end)}"


def _computed_until(reached: float, begin: float, end: float) -> str:
    """Say until when a step was computed, as the slave has it."""
    found = within(reached, begin, end)
    if found is None:
        return f"computed until t = {reached:g} s as it says, which is not in the step"
    return f"computed until t = {found:g} s"
