"""Cells of the matrix: a kind of loop with one fault, or one unbroken change, flown and judged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from random import Random

from falsifier import (  # noqa: F401 - each adds its faults
    break_events,
    break_measurements,
    break_numbers,
    break_parts,
    break_times,
    break_wiring,
)
from falsifier.draft import Draft, NotHere
from falsifier.faults import FAULTS, Fault
from falsifier.flight import Field, Flight
from falsifier.kinds import LOOPS
from falsifier.loop import Loop
from falsifier.unbroken import VARIANTS, Variant

FALSE = "claimed and false"
BROKEN = "claimed though broken"
REFUSED = "unbroken and not claimed"
BROKE = "broken off by an error of ours"
GOOD = "as it must be"


@dataclass(frozen=True)
class Cell:
    """What became of one case.

    Attributes
    ----------
    kind, hypothesis, name : where it stands in the matrix.
    verdict : one of those above.
    flights : as they were flown.
    drawn : whether it is a case at random.
    """

    kind: str
    hypothesis: str
    name: str
    verdict: str
    runs: tuple[Flight, ...]
    drawn: bool = False

    @property
    def words(self) -> str:
        """What was said, and what was flown."""
        answers = []
        for each in self.runs:
            if each.broke is not None:
                answers.append(each.broke)
            elif each.refused is not None:
                answers.append("refused: " + " ".join(each.refused.split())[:160])
            elif each.claimed:
                answers.append(f"all {len(each.answers)} met; {each.wrong or 'no harm seen'}")
            else:
                answers.append(f"not met: {', '.join(each.unmet) or 'nothing assumed'}")
        return "; ".join(dict.fromkeys(answers))

    def to_json(self) -> dict[str, object]:
        """All of it, with the scenarios of a cell that is not good."""
        texts = [] if self.verdict == GOOD else [each.text for each in self.runs]
        head = {"kind": self.kind, "hypothesis": self.hypothesis, "name": self.name}
        return head | {"verdict": self.verdict, "said": self.words, "scenarios": texts}


def broken_cell(
    field: Field, loop: Loop, fault: Fault, dice: Random | None = None, most: int = 2
) -> Cell | None:
    """Fly a kind with one fault, so often at most; None where it has nothing to break."""
    runs = _runs_of(field, loop, fault.apply, {}, dice, most)
    if runs is None:
        return None
    verdict = _of_broken(runs, covered=bool(fault.covered))
    return Cell(loop.name, fault.hypothesis, fault.name, verdict, runs, dice is not None)


def unbroken_cell(field: Field, loop: Loop, variant: Variant, most: int = 2) -> Cell | None:
    """Fly a kind with a change that breaks nothing; None where there is nothing to change."""
    if loop.unproved:
        return None
    runs = _runs_of(field, loop, variant.apply, variant.options, None, most)
    if runs is None:
        return None
    return Cell(loop.name, "unbroken", variant.name, _unbroken(runs), runs)


def designed_cell(field: Field, loop: Loop) -> Cell:
    """Fly a kind as designed: it claims, or must not."""
    runs = _runs_of(field, loop, lambda _: None, {}, None) or ()
    if not loop.unproved:
        return Cell(loop.name, "unbroken", "as designed", _unbroken(runs), runs)
    verdict = _of_broken(runs, covered=False)
    return Cell(loop.name, "not provable", loop.unproved, verdict, runs)


def _of_broken(runs: Sequence[Flight], *, covered: bool) -> str:
    if any(x.claimed and x.wrong for x in runs):
        return FALSE
    if any(x.broke is not None for x in runs):
        return BROKE
    return BROKEN if any(x.claimed for x in runs) and not covered else GOOD


def _unbroken(runs: Sequence[Flight]) -> str:
    if any(x.claimed and x.wrong for x in runs):
        return FALSE
    if any(x.broke is not None for x in runs):
        return BROKE
    return GOOD if all(x.claimed for x in runs) else REFUSED


def _runs_of(
    field: Field,
    loop: Loop,
    apply: Callable[[Draft], None],
    options: dict[str, str],
    dice: Random | None,
    most: int = 2,
) -> tuple[Flight, ...] | None:
    """Both flights of a kind, or the one that a change applies to; None if neither."""
    state = None if dice is None else dice.getstate()
    runs = []
    for data in (loop.scenario, loop.driven):
        if data is None or len(runs) == most:
            continue
        if dice is not None and state is not None:
            dice.setstate(state)  # the same fault in both
        draft = Draft(loop, data, dice)
        try:
            apply(draft)
        except NotHere:
            continue
        runs.append(field.fly(loop, draft.data, **options))
    return tuple(runs) or None


Case = Callable[[Field], Cell | None]
ALL = tuple(x.name for x in LOOPS)
QUICK = ("any", "exact", "two", "inside")
"""Kinds that every run of the tests flies."""


def matrix(*, quick: bool = False, kinds: Sequence[str] = ALL, claims: bool = False) -> list[Case]:
    """Every kind with every fault and every unbroken change.

    With `quick` the quick ones among them, in one flight each: that from an offset where there is
    one. With `claims` without what is unbroken: the cells in which a claim can be wrong.
    """
    wanted = [x for x in LOOPS if x.name in kinds]
    most_runs = 1 if quick else 2
    found: list[Case] = [lambda field, loop=loop: designed_cell(field, loop) for loop in wanted]
    for loop in wanted:
        if not loop.unproved:
            found += [
                lambda field, loop=loop, fault=fault: broken_cell(
                    field, loop, fault, None, most_runs
                )
                for fault in FAULTS
                if fault.quick or not quick
            ]
        found += [
            lambda field, loop=loop, change=change: unbroken_cell(field, loop, change, most_runs)
            for change in VARIANTS
            if (change.quick or not quick) and not claims
        ]
    return found


def drawn(seed: int, count: int, kinds: Sequence[str] = ALL) -> Iterator[Case]:
    """Cases at random: a kind, perhaps with an unbroken change, and one fault of random size."""
    dice = Random(seed)  # noqa: S311 - no secret
    provable = [x for x in LOOPS if not x.unproved and x.name in kinds]
    for number in range(count if provable else 0):
        loop, fault = dice.choice(provable), dice.choice(FAULTS)
        beside = dice.choice(VARIANTS) if dice.random() < 0.5 else None
        yield _drawn(loop, fault, beside, seed * 1_000_003 + number)


def _drawn(loop: Loop, fault: Fault, beside: Variant | None, seed: int) -> Case:
    def apply(draft: Draft) -> None:
        if beside is not None:
            try:
                beside.apply(draft)
            except NotHere:
                draft.data = Draft(loop, draft.data).data
        fault.apply(draft)

    name = fault.name if beside is None else f"{fault.name}, with {beside.name}"
    both = Fault(fault.hypothesis, name, apply, covered=fault.covered)
    return lambda field: broken_cell(field, loop, both, Random(seed))  # noqa: S311
