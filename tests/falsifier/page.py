"""The page of the matrix: which hypothesis was broken in which kind of loop, and what was said."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from falsifier.cells import BROKE, BROKEN, FALSE, GOOD, REFUSED, Cell
from falsifier.kinds import LOOPS

HEAD = """\
# The falsifier

A run claims its guarantee where it says that every assumption is met. This page says what became of
attempts to make a run claim wrongly. Loops of every kind of design are flown, most of them
unstable when open; in each, one hypothesis of its proof is broken, alone. What flew is judged by
its recorded rows alone: a claim is **false** if a state grows a hundredfold, or if the measured
gain passes gamma.

This page is made by a command, which flies every cell:

<!-- not run: minutes to an hour, by what is asked for -->
```sh
{command}
```

| in a cell | what it means |
|---|---|
| no | the run says which assumption is not met |
| refused | the scenario is refused before it runs |
| yes | of what is unbroken: the run claims its guarantee, as it must |
| CLAIMED | the hypothesis is broken, and the run claims its guarantee, though no harm was seen |
| FALSE | it claims its guarantee, and its rows show that it does not hold |
| UNCLAIMED | nothing is broken, and the run does not claim |
| ERROR | the run broke off with an error that no user may see |
| (empty) | this kind has nothing of that to break |

"""
MARK = {FALSE: "**FALSE**", BROKEN: "**CLAIMED**", REFUSED: "**UNCLAIMED**", BROKE: "**ERROR**"}


def page(cells: Sequence[Cell], drawn: Sequence[Cell], seed: int, command: str) -> str:
    """The page as Markdown.

    Parameters
    ----------
    cells, drawn : of the matrix with its edges, and at random.
    seed : of the random ones.
    command : that flew them.
    """
    text = (
        HEAD.replace("{command}", command)
        + "## Kinds of loops\n\n| kind | what it is |\n|---|---|\n"
    )
    text += "".join(f"| {x.name} | {x.words} |\n" for x in LOOPS) + "\n"
    text += counts(cells, drawn, seed) + "\n"
    for hypothesis in dict.fromkeys(x.hypothesis for x in cells if x.hypothesis != "edges"):
        text += _table(hypothesis, [x for x in cells if x.hypothesis == hypothesis])
    edges = [x for x in cells if x.hypothesis == "edges"]
    if edges:
        text += "## At the bound\n\nThe predicate flips at the proved value, to a nanosecond.\n\n"
        text += "| kind | bound | |\n|---|---|---|\n"
        text += "".join(
            f"| {x.kind} | {x.name} | {MARK.get(x.verdict, 'flips')} |\n" for x in edges
        )
        text += "\n"
    wrong = [x for x in (*cells, *drawn) if x.verdict != GOOD]
    text += "## What is not as it must be\n\n"
    if not wrong:
        return text + "Nothing.\n"
    text += "| kind | broken | verdict | said and flown |\n|---|---|---|---|\n"
    rows = (f"| {x.kind} | {x.name} | {x.verdict} | {_plain(x.words)} |\n" for x in wrong)
    return text + "".join(rows)


def counts(cells: Sequence[Cell], drawn: Sequence[Cell], seed: int) -> str:
    """How many cells there are, by verdict."""
    heads = ("", "cells", FALSE, BROKEN, REFUSED, BROKE)
    text = f"| {' | '.join(heads)} |\n"
    text += "|---|---|---|---|---|---|\n"
    for name, some in (("matrix and bounds", cells), (f"at random, seed {seed}", drawn)):
        if not some:
            continue
        found = Counter(x.verdict for x in some)
        row = (name, len(some), found[FALSE], found[BROKEN], found[REFUSED], found[BROKE])
        text += f"| {' | '.join(map(str, row))} |\n"
    return text


def _table(hypothesis: str, cells: Sequence[Cell]) -> str:
    kinds = [x.name for x in LOOPS if any(c.kind == x.name for c in cells)]
    text = f"## {hypothesis[0].upper()}{hypothesis[1:]}\n\n"
    text += f"| | {' | '.join(kinds)} |\n|---|{'---|' * len(kinds)}\n"
    for name in dict.fromkeys(x.name for x in cells):
        row = {x.kind: _mark(x) for x in cells if x.name == name}
        text += f"| {name} | {' | '.join(row.get(kind, '') for kind in kinds)} |\n"
    return text + "\n"


def _mark(cell: Cell) -> str:
    if cell.verdict in MARK:
        return MARK[cell.verdict]
    if cell.hypothesis == "unbroken":
        return "yes"
    return "refused" if all(x.refused is not None for x in cell.runs) else "no"


def _plain(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;")
