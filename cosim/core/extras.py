"""Packages that only some need: imported when they are, and named with their extra if missing."""

from __future__ import annotations

import sys
from typing import Any

from cosim.core.errors import InputError


def optional(*modules: str, extra: str, what: str, otherwise: str | None = None) -> Any:
    """A package of an extra, by the names of its modules, the package itself first.

    Parameters
    ----------
    what : a sentence without its end: "data frames need pandas".
    otherwise : what can be done without it.

    Raises
    ------
    InputError : it is not installed; says which extra is to be.
    """
    try:
        for name in modules:
            __import__(name)
    except ImportError as error:
        hint = f"install the extra: pip install 'auv-cosim[{extra}]'"
        raise InputError(
            what, got=str(error), hint=hint if otherwise is None else f"{hint}; or {otherwise}"
        ) from error
    return sys.modules[modules[0]]
