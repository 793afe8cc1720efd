"""What the distributions of an environment take on disk, and who requires each."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from rich.table import Table

SIX = ("fmpy", "pythonfmu", "cvxpy", "clarabel", "numpy", "mcap")
"""What a user of this project has chosen: FMUs, their Python slaves, LMIs, arrays, traces."""

PROJECT = "auv-cosim"
GROUPS = {"chosen": "the six packages, with theirs", "added": f"{PROJECT}, and what it adds"}

WITHOUT = {
    "isal": "checksums of traces take ten times as long",
    "latex2mathml": "the page in an FMU would show no equations",
    "lazy-loader": "every command would load all that any command needs",
    "markdown-it-py": "the same page; rich requires it, too",
    "msgspec": "messages between processes would be believed without a check",
    "protobuf": "messages of others in a trace could not be read",
    "pydantic": "no mistake in a file would be named with its line; typer requires it, too",
    "python-flint": "there would be no exact proof",
    "rich": "no table would fit its terminal; typer requires it, too, and it requires pygments",
    "threadpoolctl": "last digits would depend on the number of cores",
    "tomli-w": "no TOML file could be written",
    "typer": "the command line would be written anew",
}
"""What leaving each requirement beside the six would cost."""


@dataclass(frozen=True)
class Size:
    """A distribution: its group, MB (1e6 bytes, byte code included), and who requires it.

    without : what it would cost to leave it, where this project requires it beside the six.
    """

    name: str
    group: str
    megabytes: float
    required_by: tuple[str, ...]
    without: str = ""


def sizes(path: Iterable[Path] | None = None, *, root: str = PROJECT) -> list[Size]:
    """Return what `root` brings, with all that it requires without extras, largest first.

    path : folders of distributions; by default those of this environment.
    """
    folders = sys.path if path is None else [*map(str, path)]
    known: dict[str, Distribution] = {}
    brought, chosen = (_closure(known, folders, names) for names in ([root], SIX))
    result = [
        Size(
            name,
            "chosen" if name in chosen else "added",
            megabytes_of(known[name]),
            tuple(sorted(other for other in brought if name in _required(known[other]))),
            WITHOUT.get(name, "") if name not in chosen else "",
        )
        for name in brought
    ]
    return sorted(result, key=lambda one: (-one.megabytes, one.name))


def _closure(known: dict[str, Distribution], folders: list[str], names: Iterable[str]) -> set[str]:
    """Return the names with all that they require, directly or not; note their distributions."""
    found: set[str] = set()
    ahead = [*names]
    while ahead:
        name = ahead.pop()
        if name not in found:
            found.add(name)
            if name not in known:
                known[name] = next(iter(Distribution.discover(name=name, path=folders)))
            ahead += _required(known[name])
    return found


def _required(distribution: Distribution) -> Iterator[str]:
    """Yield the names of what a distribution requires on this machine, without extras."""
    for text in distribution.requires or ():
        wanted = Requirement(text)
        if wanted.marker is None or wanted.marker.evaluate({"extra": ""}):
            yield canonicalize_name(wanted.name)


def megabytes_of(distribution: Distribution) -> float:
    """Return the size of all files of a distribution [MB]."""
    files = (Path(str(distribution.locate_file(file))) for file in distribution.files or ())
    return sum(file.stat().st_size for file in files if file.is_file()) / 1e6


def table_of(found: list[Size]) -> Table:
    """Return a plain table, a group after the other, and the sum."""
    table = Table(box=None, pad_edge=False)
    for column in ("distribution", "MB", "required by", "without it"):
        table.add_column(column, justify="right" if column == "MB" else "left")
    for group, title in GROUPS.items():
        rows = [one for one in found if one.group == group]
        table.add_row(title, _mb(rows), f"{len(rows)} distributions", style="bold")
        for one in rows:
            required_by = ", ".join(one.required_by)
            table.add_row(f"  {one.name}", f"{one.megabytes:.1f}", required_by, one.without)
    table.add_row("all", _mb(found), f"{len(found)} distributions", style="bold")
    return table


def figures_of(found: list[Size]) -> dict[str, Any]:
    """Return the table as JSON."""
    return {
        "megabytes": round(sum(one.megabytes for one in found), 1),
        "count": len(found),
        "groups": [
            {
                "group": title,
                "megabytes": round(sum(one.megabytes for one in found if one.group == group), 1),
                "count": sum(one.group == group for one in found),
                "distributions": [
                    {
                        "name": one.name,
                        "megabytes": round(one.megabytes, 2),
                        "required_by": one.required_by,
                        "without": one.without or None,
                    }
                    for one in found
                    if one.group == group
                ],
            }
            for group, title in GROUPS.items()
        ],
    }


def _mb(rows: list[Size]) -> str:
    return f"{sum(one.megabytes for one in rows):.1f}"
