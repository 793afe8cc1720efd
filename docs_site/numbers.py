"""Numbers in pages that this project computes: each names how, and is computed again and compared.

A number in a page of docs, or in the README, is followed by a comment with its name, which no
reader sees:

    greatest age 1.1671<!-- = networked-constant --> s

`numbers.toml` has an expression for each name, of the functions in `number_terms`. What it gives
must be what stands in the page, at the digits that stand there. `mkdocs build` fails where it is
not; it leaves out numbers that take long, `python -m docs_site.numbers` does not.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
TABLE = Path(__file__).with_suffix(".toml")
_MARKED = re.compile(r"(?P<printed>[-−]?\d*\.?\d+)?<!-- = (?P<name>[^>]*?) -->")
_ROUNDED = {"nearest": ROUND_HALF_EVEN, "down": ROUND_FLOOR, "up": ROUND_CEILING}


@dataclass(frozen=True)
class Computed:
    """How a number is computed.

    name : in the comments of pages.
    value : an expression of Python, of the names in `number_terms`.
    rounded : "nearest", or "down" or "up" for a bound that must still hold as it is printed.
    slow : takes more than some seconds.
    """

    name: str
    value: str
    rounded: str = "nearest"
    slow: bool = False

    def in_digits_of(self, printed: str) -> str:
        """Return the number, computed, with as many decimals as are printed."""
        return str(Decimal(_value(self.value)).quantize(_one(printed), _ROUNDED[self.rounded]))


@dataclass(frozen=True)
class Printed:
    """A number in a page, the name behind it, and where it stands: `docs/page.md:12`."""

    number: str
    name: str
    where: str


def table(text: str | None = None) -> dict[str, Computed]:
    """Return how every number is computed, by name; `text` : in place of `numbers.toml`."""
    data = tomllib.loads(TABLE.read_text("utf-8") if text is None else text)
    return {name: Computed(name, **keys) for name, keys in data.items()}


def pages() -> list[Path]:
    """Return the README and every page of docs."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def printed_in(text: str, where: str) -> Iterator[Printed]:
    """Yield every number of a page that names how it is computed, empty where none precedes."""
    for match in _MARKED.finditer(text):
        line = text.count("\n", 0, match.start()) + 1
        yield Printed(match["printed"] or "", match["name"], f"{where}:{line}")


def all_printed() -> list[Printed]:
    """Return those of every page."""
    return [
        one
        for page in pages()
        for one in printed_in(page.read_text("utf-8"), str(page.relative_to(ROOT)))
    ]


def faults(
    printed: Iterable[Printed],
    computed: dict[str, Computed],
    *,
    of: Callable[[Computed], bool] = lambda _: True,
) -> Iterator[str]:
    """Yield what is wrong with the numbers of pages; `of` : which of them are computed."""
    for one in printed:
        own = computed.get(one.name)
        if own is None:
            yield f"{one.where}: {TABLE.name} has no {one.name!r}"
        elif not one.number:
            yield f"{one.where}: no number before the comment {one.name!r}"
        elif of(own):
            found = own.in_digits_of(one.number)
            if Decimal(found) != Decimal(_plain(one.number)):
                yield f"{one.where}: {one.number} is printed, {own.value} is {found}"


def require_quick() -> None:
    """Compute the quick ones, as the build of the pages does.

    Raises
    ------
    ValueError : with every number that differs.
    """
    wrong = list(faults(all_printed(), table(), of=lambda one: not one.slow))
    if wrong:
        raise ValueError("\n".join(["numbers in pages are not those computed", *wrong]))


def _one(printed: str) -> Decimal:
    """Return one of the last digit of a number."""
    return Decimal(1).scaleb(-len(printed.partition(".")[2]))


def _plain(printed: str) -> str:
    return printed.replace("−", "-")


@cache
def _value(expression: str) -> float:
    from docs_site import number_terms  # noqa: PLC0415 - solvers, for those that compute

    return float(eval(expression, dict(vars(number_terms))))  # noqa: S307 - of numbers.toml


if __name__ == "__main__":
    wrong = list(faults(all_printed(), table()))
    print("\n".join(wrong) or f"{len(all_printed())} numbers in pages are those computed")
    sys.exit(bool(wrong))
