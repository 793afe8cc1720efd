"""All errors that reach a user.

A message says what is wrong and where, what was expected, what was got, and what to do. The
command line prints it without a traceback and exits with `exit_code`.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from functools import partial
from typing import Any, ClassVar


class CosimError(Exception):
    """Base of every error raised on purpose.

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
        return "\n".join([head, *lines])

    def to_json(self) -> dict[str, str | None]:
        """Return the parts of the message, as `--json` prints them."""
        return {key: getattr(self, key) for key in ("what", "where", "expected", "got", "hint")}


class InputError(CosimError, ValueError):
    """Bad input or usage: a file, a key, a value, a shape, a name."""

    exit_code = 2

    @classmethod
    def unknown(
        cls, kind: str, name: str, known: Iterable[str], *, where: str | None = None
    ) -> InputError:
        """Make the error for a name that does not exist, with the nearest that do."""
        names = sorted(known)
        near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
        listed = ", ".join(names) if len(names) <= 12 else f"one of {len(names)} names"
        return cls(
            f"there is no {kind} {name!r}",
            where=where,
            expected=listed or "nothing: there is none",
            hint=f"did you mean {' or '.join(near)}?" if near else None,
        )


class CheckFailedError(CosimError):
    """An assertion or a comparison of the user does not hold."""

    exit_code = 1


class LossError(CosimError):
    """The command succeeded, but recorded data is missing (an incomplete or damaged trace)."""

    exit_code = 3


class ComponentError(CosimError):
    """A component (an FMU) failed to load, initialise or step.

    `kind`, `component`, `call`, `detail` : how the process of an isolated component ended, and in
    which FMI call, as in the cause of a run; None for a component that answered.
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

    `certificate` : the exact proof of infeasibility, for `check_certificate`, if there is one.
    """

    exit_code = 5

    def __init__(
        self, what: str, *, certificate: dict[str, Any] | None = None, **more: str | None
    ) -> None:
        self.certificate = certificate
        super().__init__(what, **more)


class StoppedError(CosimError):
    """The user interrupted a task that can be resumed; its results so far are kept."""

    exit_code = 130


class TerminatedError(StoppedError):
    """SIGTERM ended a task; its results so far are kept."""

    exit_code = 143
