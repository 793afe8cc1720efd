"""Import of optional packages, with an error that names the missing extra."""

from __future__ import annotations

import sys
from typing import Any

from cosim.core.errors import InputError


def optional(*modules: str, extra: str, what: str, otherwise: str | None = None) -> Any:
    """Import modules of an optional package and return the first, the package itself.

    Parameters
    ----------
    what : of the message, without a full stop: "data frames need pandas".
    otherwise : what can be done without the package.

    Raises
    ------
    InputError : it is not installed; the hint names the extra.
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
