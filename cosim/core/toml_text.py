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
            hint=_hint(reason, content),
        ) from error
    except (ValueError, RecursionError) as error:
        # beyond the limits of the parser: an integer of thousands of digits, deep nesting
        hint = "numbers of fewer digits, and fewer brackets within brackets"
        raise InputError("malformed TOML", where=where, got=str(error), hint=hint) from error
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
    (
        r"[^=]*=\s*[-+]?\d+,\d+",
        "a decimal point, as in 0.5; several values are a list: [1, 2]",
    ),
    (r"[^=]*=\s*[-+]?[\d.]+\s*[A-Za-z%].*", 'a number with its unit is written in quotes: "50 ms"'),
    (r"[^=]*=\s*(?!true|false|inf|nan)[A-Za-z].*", "a text is written in quotes"),
    (r"(%|//|;).*", "a comment begins with #"),
    (r"[\w.-]+\s*:.*", "a key and its value are joined by =, as in end = 10.0"),
    (r"[^=]*=", "a value behind the =; a text is written in quotes"),
    (r"\{.*", "this looks like JSON: a design is JSON, systems and scenarios are TOML"),
)
"""What a malformed line looks like, and what to do about it."""


_REASONS = (
    (r".*illegal character '\\n'.*|[Uu]nterminated string.*", "end the text with a quote"),
    (
        r"Cannot (overwrite a value|declare .* twice).*",
        "each key once in its table, each table once; of several tables [[NAME]] each",
    ),
    (r"Unclosed (array|inline table).*|.*in an array.*", "a bracket that closes each one"),
)
"""Why the parser refuses, and what to do where the line itself does not say more."""
_USUAL = 'a line is key = value, [table] or [[table]]; a text stands in quotes: "a text"'


def _hint(reason: str, content: str) -> str:
    known = (hint for pattern, hint in _HINTS if re.fullmatch(pattern, content))
    usual = (hint for pattern, hint in _REASONS if re.fullmatch(pattern, reason))
    if reason.startswith("Cannot"):
        return next(usual, _USUAL)
    return next(known, None) or next(usual, _USUAL)
