"""An exception as a message: what a worker raises is raised again by who wanted the work."""

from __future__ import annotations

import traceback
from typing import Final

import msgspec

from cosim.core import errors
from cosim.core.errors import ComponentError, CosimError

_KINDS: Final = {
    name: kind
    for name, kind in vars(errors).items()
    if isinstance(kind, type) and issubclass(kind, CosimError)
}
_PARTS: Final = ("where", "expected", "got", "hint")
_OF_COMPONENTS: Final = ("kind", "component", "call", "detail")


class RaisedError(msgspec.Struct, array_like=True):
    """An error of this project with its parts; another exception is one in words.

    Attributes
    ----------
    kind : the name of its class.
    what, parts : as of `CosimError`.
    trace : its traceback, which becomes a note.
    """

    kind: str
    what: str
    parts: dict[str, str | None]
    trace: str

    @classmethod
    def of(cls, error: BaseException) -> RaisedError:
        """Return the message of an exception."""
        trace = "".join(traceback.format_exception(error))
        if not isinstance(error, CosimError):
            return cls("CosimError", f"unexpected {type(error).__name__}: {error}", {}, trace)
        kind = next(one.__name__ for one in type(error).__mro__ if one.__name__ in _KINDS)
        parts = {key: getattr(error, key) for key in _keys(type(error))}
        return cls(kind, error.what, parts, trace)

    def error(self) -> CosimError:
        """Return the exception."""
        kind = _KINDS.get(self.kind, CosimError)
        parts = {key: self.parts.get(key) for key in _keys(kind)}
        found: CosimError = kind(self.what, **parts)
        found.add_note(self.trace)
        return found


def _keys(kind: type[CosimError]) -> tuple[str, ...]:
    return (*_PARTS, *_OF_COMPONENTS) if issubclass(kind, ComponentError) else _PARTS
