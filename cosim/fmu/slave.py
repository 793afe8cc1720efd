"""One running FMU slave, of FMI 2.0 or 3.0.

Life cycle, each step once and in this order:

    FmuSlave(...)  ->  set_start  ->  enter_initialisation  ->  exit_initialisation
                   ->  step ...   ->  close

`initialise` does the three in the middle. `write` is allowed from the start and `read` from
`enter_initialisation` on, if the standard allows it for the variable. After an error only `close`
is allowed. `close` terminates and frees the slave; it may be called at any time, repeatedly.

An FMI 3 slave runs without event mode, early return and intermediate updates, which are optional.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, Self

from cosim.core import ComponentError
from cosim.fmu.description import FmuDescription
from cosim.fmu.instance import DISCARD, WARNING
from cosim.fmu.messages import LogSink
from cosim.fmu.state import StateAccess

_TERMINATED = 3
"""fmi2StatusKind."""


class StepResults(ctypes.Structure):
    """The results of fmi3DoStep: three C bools at 0, 1 and 2, a double at 8; 16 bytes."""

    _fields_ = (
        ("event_handling_needed", ctypes.c_bool),
        ("terminate_simulation", ctypes.c_bool),
        ("early_return", ctypes.c_bool),
        ("last_successful_time", ctypes.c_double),
    )


class FmuSlave(StateAccess):
    """A running slave; see the module for its life cycle.

    Parameters
    ----------
    name : of the component, in every message.
    log : receives the FMU's messages.
    categories : of the log messages wanted, as the FMU declares them; None: all. Messages with a
        status beyond Warning are always passed on.

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
    ) -> None:
        super().__init__(description, name, log, categories=categories)
        self._results = StepResults()
        self._discarded: bool | None = None

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
        self.call("a reset", "Reset")
        self.phase = "instantiated"

    def enter_initialisation(self, start: float, stop: float | None) -> None:
        """Enter initialization mode of a run from `start` to `stop` [s]; None: no end."""
        has_stop, end = stop is not None, stop if stop is not None else 0.0
        what = "entering the initialisation"
        if self.version == "2.0":
            self.call("setting up the experiment", "SetupExperiment", 0, 0.0, start, has_stop, end)
            self.call(what, "EnterInitializationMode")
        else:
            no_tolerance = (False, 0.0)
            self.call(what, "EnterInitializationMode", *no_tolerance, start, has_stop, end)
        self.phase = "initialising"

    def exit_initialisation(self) -> None:
        """Leave initialization mode: the slave is ready to step.

        Raises
        ------
        InputError : the slave does not start with a start value that it was given.
        ComponentError : the slave refuses or has logged an error, the only way some exporters have.
        """
        self.call("the initialisation", "ExitInitializationMode")
        if self._logged_error is not None:
            self.phase = "failed"
            raise ComponentError(
                "the initialisation failed", where=self._where, got=self._logged_error
            )
        self.phase = "stepping"
        self._check_taken()

    def step(self, time: float, size: float) -> None:
        """Advance from `time` by `size` [s]; `asked_to_end` tells whether the slave wants to stop.

        Raises
        ------
        ComponentError : the slave cannot compute the step.
        """
        what = f"step from t = {time:g} s"
        self._logged_error = None
        no_way_back = not self._states
        if self.version == "3.0":
            at = self.step_results
            self.call(what, "DoStep", time, size, no_way_back, at, at + 1, at + 2, at + 8)
            if self._results.early_return:
                self.phase = "failed"
                raise ComponentError(
                    f"{what} ended early, which was not allowed",
                    where=self._where,
                    got=f"t = {self._results.last_successful_time:g} s",
                )
            return
        status = self.status_of("DoStep", time, size, no_way_back)
        self._discarded = status == DISCARD
        if status > WARNING and not (self._discarded and self.asked_to_end()):
            raise self.refused(what, status)

    @property
    def step_results(self) -> int:
        """Address of the four out-arguments of fmi3DoStep, laid out as `StepResults`."""
        return ctypes.addressof(self._results)

    def asked_to_end(self) -> bool:
        """Whether the slave wants the run to end with the last step.

        In FMI 2 it asks by Discard; a caller of fmi2DoStep itself calls this after Discard only.
        After a logged error the step has failed instead; so it has with PythonFMU, which reports
        every failed step as such a wish.
        """
        if self.version == "3.0":
            return bool(self._results.terminate_simulation)
        if self._discarded is False or self._logged_error is not None or self._of_pythonfmu:
            return False
        value = ctypes.c_int(0)
        error = self.last_error
        try:
            status = self.status_of("GetBooleanStatus", _TERMINATED, ctypes.byref(value))
        except ComponentError:  # no such function, or already at its end
            return False
        finally:
            self.last_error = error  # keep the error of the step
        return status <= WARNING and bool(value.value)

    def close(self) -> None:
        """Terminate and free, once."""
        if self.phase != "closed":
            self._free_all()
            self.end(terminate=self.phase == "stepping")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
