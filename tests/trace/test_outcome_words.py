"""What an outcome says of assumptions, and how it reads what other versions and tools wrote."""

from __future__ import annotations

import pytest

from cosim.trace import RunOutcome
from cosim.trace.outcome import AssertionResult, Cause, EventCount, assumptions_of

NAMES = (
    *("certificate_verified", "claim_known", "observer_knows_commands", "loop_as_designed"),
    *("plant_as_designed", "controller_as_designed", "sensors_as_designed", "values_delivered"),
    *("plant_follows_law", "controller_follows_law", "measurements_true"),
    *("message_age_within_design", "message_age_not_below_least"),
    *("message_age_sampled", "message_age_constant", "state_inside_envelope"),
    *("limits_not_reached", "age_of_depth_within_design", "age_of_commands_sampled"),
)


@pytest.mark.parametrize("name", NAMES)
def test_an_assumption_has_words_of_its_own(name: str) -> None:
    """Not its name with spaces, which tells an engineer less."""
    (found,) = assumptions_of(RunOutcome(metrics={"assumptions": {name: False}}))
    assert found.tone == "bad"
    assert found.what != name.replace("_", " ").capitalize()
    assert len(found.what.split()) >= 3


def test_entries_of_another_form_are_left_out_and_the_rest_is_read() -> None:
    """As a file of another version may have them; nothing is an error."""
    event = {"kind": "loss", "subject": "up", "level": "warning", "message": "3 lost"}
    found = RunOutcome.from_json(
        {
            "status": "finished",
            "steps": "many",
            "cause": {"kind": ["no", "word"]},
            "assertions": [{"assertion": 5, "result": "holds", "at_s": "late"}, {"result": "?"}, 7],
            "events": [{**event, "count": 3, "first_s": 1.5}, {**event, "count": "3"}, None],
            "metrics": [1],
            "links": {"up": None, "down": {"sent": 4}},
        }
    )
    assert (found.steps, found.cause, found.metrics, found.version) == (None, None, {}, 1)
    assert [(each.words, each.at_s) for each in found.assertions] == [("5", None)]
    assert [(each.count, each.total_s) for each in found.events] == [(3, None)]
    assert found.links == {"up": {}, "down": {"sent": 4}}


def test_what_this_program_makes_is_validated_and_not_mended() -> None:
    """A default in place of a wrong value would hide a fault of ours."""
    with pytest.raises(ValueError, match="steps"):
        RunOutcome(steps="many")  # type: ignore[arg-type]


def test_each_part_of_an_outcome_is_json_of_its_own() -> None:
    """As in the whole, which is read again from it."""
    whole = RunOutcome(
        cause=Cause("refused", "plant", "fmi2DoStep", 1.5, "no"),
        assertions=(AssertionResult(words="x < 1", name="near", result="fails", at_s=2.0),),
        events=(EventCount("loss", "up", "warning", "3 lost", 3, 1.5, 0.5),),
    )
    written = whole.to_json()
    assert whole.cause is not None
    assert whole.cause.to_json() == written["cause"]
    assert [each.to_json() for each in whole.assertions] == written["assertions"]
    assert [each.to_json() for each in whole.events] == written["events"]
    assert written["assertions"][0]["assertion"] == "x < 1"
    assert written["assertions"][0]["as_expected"] is False
    assert RunOutcome.from_json(written) == whole
