"""Parse TOML, with the line of what is malformed."""

from __future__ import annotations

import gc
import re
import tomllib
from typing import Any

from cosim.core.errors import InputError


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """Parse TOML.

    Raises
    ------
    InputError : it is malformed; the message has the line and its content.
    """
    # a finaliser that the collector runs where nesting has used up the stack would fail, and say so
    collecting = gc.isenabled()
    gc.disable()
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        place = re.search(r"line (\d+)", str(error))
        # "at end of document": the last line is where something is missing
        lines = text.splitlines() or [""]
        line = int(place.group(1)) if place else len(lines)
        content = lines[min(line, len(lines)) - 1].strip()
        raise InputError(
            "malformed TOML", where=f"{where}:{line}", expected=str(error), got=content
        ) from error
    except (ValueError, RecursionError) as error:
        # beyond the limits of the parser: an integer of thousands of digits, deep nesting
        raise InputError("malformed TOML", where=where, got=str(error)) from error
    finally:
        if collecting:
            gc.enable()
