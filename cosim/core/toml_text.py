"""Parse TOML, with the line of what is malformed."""

from __future__ import annotations

import gc
import re
import tomllib
from typing import Any

from cosim.core.errors import InputError

_PLACE = re.compile(r" \(at (line|end).*\)$")


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
        reason = _PLACE.sub("", str(error))
        raise InputError(
            f"malformed TOML: {reason[:1].lower()}{reason[1:]}",
            where=f"{where}:{line}",
            got=content,
            hint=_hint(content),
        ) from error
    except (ValueError, RecursionError) as error:
        # beyond the limits of the parser: an integer of thousands of digits, deep nesting
        raise InputError("malformed TOML", where=where, got=str(error)) from error
    finally:
        if collecting:
            gc.enable()


_NUMBER = r"[-+.\d\seE()]*"
_HINTS = (
    (
        r'[^=]*=\s*".*\\.*',
        "write single quotes, or forward slashes: 'C:\\file', 'C:/file'",
    ),
    (
        rf"[^=]*=\s*{_NUMBER}\d\s*[*/^]{_NUMBER}",
        "a value is one number: write the result of the calculation",
    ),
    (r"[^=]*=\s*[-+]?[\d.]+\s*[A-Za-z%].*", 'a number with its unit is written in quotes: "50 ms"'),
    (r"[^=]*=\s*(?!true|false|inf|nan)[A-Za-z].*", "a text is written in quotes"),
    (r"(%|//|;).*", "a comment begins with #"),
    (r"\{.*", "this looks like JSON: a design is JSON, systems and scenarios are TOML"),
)
"""What a malformed line looks like, and what to do about it."""


def _hint(content: str) -> str | None:
    return next((hint for pattern, hint in _HINTS if re.fullmatch(pattern, content)), None)
