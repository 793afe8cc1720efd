"""No run claims its guarantee where a hypothesis of its proof is broken."""

from __future__ import annotations

from pathlib import Path

import pytest
from falsifier.cells import BROKEN, FALSE, GOOD, QUICK, Case, Cell, broken_cell, drawn, matrix
from falsifier.claim_too_much import MUTATIONS
from falsifier.edges import EDGES, Edge, edge_cell
from falsifier.faults import FAULTS
from falsifier.flight import Field, Flight, claims
from falsifier.kinds import LOOPS
from falsifier.loop import Loop
from shared import sampled, share_of

ROOT = Path(__file__).resolve().parents[2]
SEED = 1


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory, native_fmus: Path) -> Field:
    return Field(tmp_path_factory.mktemp("falsifier"), native_fmus.parent)


def words_of(cells: list[Cell]) -> str:
    """What is not as it must be, with the scenario to fly again."""
    wrong = [x for x in cells if x.verdict != GOOD]
    heads = [f"{x.kind}, {x.hypothesis}, {x.name}: {x.verdict}: {x.words}" for x in wrong]
    return "\n".join([*heads, *(x.runs[0].text for x in wrong[:1])])


def run_all(cases: list[Case], field: Field) -> list[Cell]:
    return [cell for case in cases if (cell := case(field)) is not None]


def test_the_text_of_every_mutation_stands_once_in_the_tree() -> None:
    """One that stands nowhere would change nothing, and would not be known to be noticed."""
    counts = {x.name: (ROOT / x.file).read_text("utf-8").count(x.old) for x in MUTATIONS}
    assert {name: count for name, count in counts.items() if count != 1} == {}


@pytest.mark.parametrize("kind", sampled(QUICK, 1))
def test_no_claim_of_the_quick_share_is_wrong(kind: str, field: Field) -> None:
    """Each hypothesis broken alone in a kind of loop, and the same loop unbroken."""
    cells = run_all(matrix(quick=True, kinds=(kind,)), field)
    assert len(cells) > 20
    assert all(x.verdict == GOOD for x in cells), words_of(cells)


@pytest.mark.parametrize(
    "edge",
    sampled([x for x in EDGES if x.kind in {"any", "two"}], 1),
    ids=lambda x: f"{x.kind}: {x.name}",
)
def test_the_predicate_flips_at_the_bound(edge: Edge, field: Field) -> None:
    """At the proved value it is met, a nanosecond beyond it is not."""
    cell = edge_cell(field, edge)
    assert cell.verdict == GOOD, words_of([cell])


@pytest.mark.slow
@pytest.mark.parametrize("loop", share_of(LOOPS), ids=lambda x: x.name)
def test_no_claim_of_the_matrix_is_wrong(loop: Loop, field: Field) -> None:
    """Every hypothesis broken alone, and every change that breaks nothing."""
    cells = run_all(matrix(kinds=(loop.name,)), field)
    assert all(x.verdict == GOOD for x in cells), words_of(cells)


@pytest.mark.slow
@pytest.mark.parametrize("edge", share_of(EDGES), ids=lambda x: f"{x.kind}: {x.name}")
def test_every_predicate_flips_at_its_bound(edge: Edge, field: Field) -> None:
    """As above, for every kind of age and every delay of a plant."""
    cell = edge_cell(field, edge)
    assert cell.verdict == GOOD, words_of([cell])


@pytest.mark.slow
def test_no_claim_of_cases_at_random_is_wrong(field: Field) -> None:
    """A kind, perhaps with an unbroken change, and one fault of random size."""
    cells = run_all(list(drawn(SEED, 40)), field)
    assert all(x.verdict == GOOD for x in cells), words_of(cells)


class Outcome:
    def __init__(self, **metrics: object) -> None:
        self.metrics = metrics


def test_a_run_claims_where_all_is_met() -> None:
    """Without an assumption nothing is claimed."""
    assert claims(Outcome(assumptions={"a": True, "b": True}))
    assert not claims(Outcome(assumptions={"a": True, "b": False}))
    assert not claims(Outcome(assumptions={}))
    assert not claims(Outcome())


@pytest.mark.slow
def test_the_judge_sees_what_is_wrong(field: Field, monkeypatch: pytest.MonkeyPatch) -> None:
    """If everything were claimed, the cells would say so: they do not pass by seeing nothing."""
    monkeypatch.setattr("falsifier.flight.claims", lambda _: True)
    loop = next(x for x in LOOPS if x.name == "any")
    cells = [
        cell
        for fault in FAULTS
        if fault.quick
        for cell in [broken_cell(field, loop, fault)]
        if cell is not None and any(x.refused is None for x in cell.runs)
    ]
    verdicts = [x.verdict for x in cells]
    assert set(verdicts) <= {FALSE, BROKEN}
    assert verdicts.count(FALSE) > len(verdicts) / 3


@pytest.mark.parametrize(
    ("flight", "seen"),
    [
        (Flight("", status="diverged"), "diverged"),
        (Flight("", status="finished", growth=101.0), "a state grows 101-fold"),
        (Flight("", status="finished", growth=float("nan")), "a state grows nan-fold"),
        (Flight("", status="finished", gain=2.0, gamma=1.0), "gain 2 above gamma 1"),
        (Flight("", status="finished", growth=2.0, gain=1.0, gamma=1.0), ""),
    ],
)
def test_what_is_wrong_with_a_flight(flight: Flight, seen: str) -> None:
    assert flight.wrong == seen
