"""Write a page to its file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from cosim.core import InputError, not_written, write_whole


def write_page(target: Path, html: str, kind: str, sources: Iterable[Path]) -> int:
    """Write a page, and return its size in bytes.

    kind, sources : what it is a report of ("trace"), and the files, which it must not replace.

    Raises
    ------
    InputError : it cannot be written, or would replace a source.
    """
    text = html.encode()
    for source in sources:
        if target.exists() and source.exists() and target.samefile(source):
            raise InputError(
                f"the report would replace its {kind}",
                where=str(target),
                hint="another place: `out`",
            )
    with not_written("the report", target, faults=(OSError, ValueError)):
        write_whole(target, text)
    return len(text)
