"""All errors that reach a user.

A message says what is wrong and where, what was expected, what was got, and what to do. The
command line prints it without a traceback and exits with `exit_code`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import partial
from typing import Any, ClassVar

from cosim.core.notices import printable


class CosimError(Exception):
    """Base of every error raised on purpose.

        >>> from cosim import CosimError, run
        >>> try:
        ...     run("paper-exampel")
        ... except CosimError as error:
        ...     print(error.what, "/", error.hint)
        there is no scenario 'paper-exampel' / did you mean paper-example?

    Parameters
    ----------
    what : what is wrong, in one sentence.
    where : the place: file and line, variable, component.
    expected, got : what would have been right, and what was found.
    hint : what to do about it.
    """

    exit_code: ClassVar[int] = 2

    def __init__(
        self,
        what: str,
        *,
        where: str | None = None,
        expected: str | None = None,
        got: str | None = None,
        hint: str | None = None,
    ) -> None:
        self.what, self.where, self.expected, self.got, self.hint = what, where, expected, got, hint
        super().__init__(self.text())

    def __reduce__(self) -> tuple[Any, ...]:
        given = {key: value for key, value in vars(self).items() if not key.startswith("_")}
        return partial(type(self), **given), ()

    def text(self) -> str:
        """Return the message as printed: place and fact on one line, then labelled lines."""
        head = f"{self.where}: {self.what}" if self.where else self.what
        labelled = {"expected": self.expected, "got": self.got, "try": self.hint}
        lines = (f"  {label}: {text}" for label, text in labelled.items() if text is not None)
        return printable("\n".join([head, *lines]))

    def to_json(self) -> dict[str, str | None]:
        """Return the parts of the message, as `--json` prints them."""
        return {key: getattr(self, key) for key in ("what", "where", "expected", "got", "hint")}


class InputError(CosimError, ValueError):
    """Bad input or usage: a file, a key, a value, a shape, a name.

        >>> from cosim import link
        >>> from cosim.core import InputError
        >>> try:
        ...     link("800 m")
        ... except InputError as error:
        ...     print(error)
        delay d: not a time
          expected: seconds, or a text with a unit, as "50 ms"
          got: a value in s; '800 m' is in m

    It is a ValueError as well.
    """

    exit_code = 2

    @classmethod
    def unknown(
        cls,
        kind: str,
        name: str,
        known: Iterable[str],
        *,
        where: str | None = None,
        hint: str | None = None,
    ) -> InputError:
        """Make the error for a name that does not exist, with the nearest that do.

        hint : what to do where no other name is near.
        """
        names = sorted(known)
        near = did_you_mean(nearest(name, names))
        most = _LISTED if near is None else _LISTED_BESIDE
        listed = ", ".join(names) if len(names) <= most else f"one of {len(names)} names"
        return cls(
            f"there is no {kind} {name!r}",
            where=where,
            expected=listed or "nothing: there is none",
            hint=near or hint or (f"one of these, such as {names[0]}" if names else None),
        )


_LISTED, _LISTED_BESIDE = 20, 12
"""Names that are listed at most, without and with near ones."""
_SHORT = 3
_NEAR, _NEAR_IF_SHORT = 0.6, 0.75


def nearest(name: str, names: Iterable[str], *, most: int = 3) -> list[str]:
    """Return the names that may be meant by one that does not exist, the nearest first.

    Short names, which are all alike, have to be nearer.
    """
    known = list(names)
    same = [other for other in known if _letters(other) == _letters(name)]
    near = _NEAR_IF_SHORT if len(name) <= _SHORT else _NEAR
    return same[:most] or difflib.get_close_matches(name, known, n=most, cutoff=near)


def did_you_mean(names: Iterable[str]) -> str | None:
    """Return the hint that offers names; None without any."""
    offered = " or ".join(names)
    return f"did you mean {offered}?" if offered else None


def counted(number: int, one: str, more: str | None = None) -> str:
    """Return a number of things in words: "1 number", "2 numbers"."""
    return f"{number} {one if number == 1 else more or one + 's'}"


def format_value(value: Any, longest: int = 60) -> str:
    """Return the `repr` of a value from a file, at most so many characters, for a message."""
    try:
        text = repr(value)
    except ValueError:  # the interpreter refuses to print an integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= longest else f"{text[: longest - 10]}... ({len(text)} characters)"


def _letters(name: str) -> str:
    return "".join(c for c in name.lower() if c.isalnum())


class CheckFailedError(CosimError):
    """An assertion or a comparison of the user does not hold."""

    exit_code = 1


class ContradictionError(CosimError):
    """A run left a bound although all that its proof assumes was met: a fault of this project."""

    exit_code = 6


class LossError(CosimError):
    """The command succeeded, but recorded data is missing (an incomplete or damaged trace).

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario, Trace, run
        >>> from cosim.core import LossError
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> whole = run(tank, "tank.mcap").trace.read_bytes()
        >>> size = Path("cut.mcap").write_bytes(whole[:-1000])
        >>> try:
        ...     Trace("cut.mcap")
        ... except LossError as error:
        ...     print(error.what)
        the trace is cut short or damaged
        >>> Trace("cut.mcap", incomplete=True).complete
        False

    With `incomplete=True` the readable part is read.
    """

    exit_code = 3


class ComponentError(CosimError):
    """A component (an FMU) failed to load, initialise or step.

        >>> from cosim import Component, Scenario, open_session
        >>> from cosim.core import ComponentError
        >>> class Sensor(Component):
        ...     outputs = {"y": 1}
        ...     def step(self, t, dt, u):
        ...         return {"y": 1 / 0}
        >>> scenario = Scenario(step=0.1, until=1).add("sensor", Sensor)
        >>> with open_session(scenario, supervise=False) as session:
        ...     try:
        ...         session.step()
        ...     except ComponentError as error:
        ...         print(error.component, error.call, "division by zero" in error.detail)
        sensor fmi2DoStep True

    `kind`, `component`, `call`, `detail` : as in the cause of a run; None where they are not known.
    `kind` is how the process of an isolated component ended, None for a component that answered;
    of a session that has failed, the kind of the cause of its run.
    """

    exit_code = 4

    def __init__(
        self,
        what: str,
        *,
        kind: str | None = None,
        component: str | None = None,
        call: str | None = None,
        detail: str | None = None,
        **more: str | None,
    ) -> None:
        self.kind, self.component, self.call, self.detail = kind, component, call, detail
        super().__init__(what, **more)


class NotAchievableError(CosimError):
    """A design is infeasible, or could not be certified.

        >>> from cosim import check_certificate, design
        >>> from cosim.core import NotAchievableError
        >>> from cosim.hinf import system_by_name
        >>> try:
        ...     design(system_by_name("paper").system, gamma=4.0)
        ... except NotAchievableError as error:
        ...     print(error.expected, check_certificate(error.certificate).valid)
        gamma > 5 True

    `certificate` : the exact proof of infeasibility, for `check_certificate`, if there is one.
    `delays`, `gamma` : the values that `hint` names in words: every delay of the system [s], or a
        bound, with which the same call is certified; None if none was found or looked for. Either
        one suffices, or both are needed `together`.
    """

    exit_code = 5

    def __init__(
        self,
        what: str,
        *,
        certificate: dict[str, Any] | None = None,
        delays: tuple[float, ...] | None = None,
        gamma: float | None = None,
        together: bool = False,
        **more: str | None,
    ) -> None:
        self.certificate = certificate
        self.delays, self.gamma, self.together = delays, gamma, together
        super().__init__(what, **more)


class StoppedError(CosimError):
    """The user interrupted a task that can be resumed; its results so far are kept."""

    exit_code = 130


class TerminatedError(StoppedError):
    """SIGTERM ended a task; its results so far are kept."""

    exit_code = 143
