"""The closed set of errors that reach a user.

Every message says what was wrong, where, what was expected, what was got and what to do
about it. The command line prints the message and leaves with `exit_code`; no traceback.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any, ClassVar


class CosimError(Exception):
    """Base of every error raised on purpose.

    Parameters
    ----------
    what : one sentence: what is wrong.
    where : file and line, variable, component: where it is wrong.
    expected, got : what would have been right, and what stood there.
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

    def text(self) -> str:
        """The message as a user reads it: one line of fact, then labelled lines."""
        head = f"{self.where}: {self.what}" if self.where else self.what
        lines = [head]
        if self.expected is not None:
            lines.append(f"  expected: {self.expected}")
        if self.got is not None:
            lines.append(f"  got: {self.got}")
        if self.hint is not None:
            lines.append(f"  try: {self.hint}")
        return "\n".join(lines)


class InputError(CosimError, ValueError):
    """Bad input or usage: a file, a key, a value, a shape, a name."""

    exit_code = 2

    @classmethod
    def unknown(
        cls, kind: str, name: str, known: Iterable[str], *, where: str | None = None
    ) -> InputError:
        """The error for a name that does not exist, with the nearest that do."""
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
    """An assertion or a comparison that was asked for does not hold."""

    exit_code = 1


class LossError(CosimError):
    """Done, but something recorded was lost (an incomplete or damaged trace)."""

    exit_code = 3


class ComponentError(CosimError):
    """A component (an FMU) failed to load, to initialise or to step."""

    exit_code = 4


class NotAchievableError(CosimError):
    """What was asked of a design cannot be had: infeasible, or not certified.

    `certificate` is the exact proof that it cannot, for `check_certificate`, where there is one.
    """

    exit_code = 5

    def __init__(
        self, what: str, *, certificate: dict[str, Any] | None = None, **more: str | None
    ) -> None:
        self.certificate = certificate
        super().__init__(what, **more)


class StoppedError(CosimError):
    """The user interrupted what can be gone on with; what was done is kept."""

    exit_code = 130
