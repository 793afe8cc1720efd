"""A guarantee is what its claim says: the loop as designed, its law as measured, the ages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from claims import Claims, claiming, with_claim
from cli.shell import cosim
from shared import fmu_store

from cosim import hinf
from cosim.core import InputError
from cosim.hinf import certificate
from cosim.hinf.certificate import AGE_FROM
from cosim.scenario import (
    FmuCache,
    execute_recorded,
    execute_unrecorded,
    load,
    parse,
    prepare,
    supervision_of,
)
from cosim.trace import RunOutcome, describe
from cosim.trace.outcome import assumptions_of, guarantee_of

ROOT = Path(hinf.__file__).parents[2]
Fly = Callable[..., Any]
_WORD = r'"((?:any, however|constant, |sampled: |from least_age)[^"]*)"'


@pytest.fixture(scope="module")
def fly(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Fly:
    folder = tmp_path_factory.mktemp("guarantee")

    def run(name: str, *settings: str) -> Any:
        loaded = load(name, settings)
        cache = FmuCache(native_fmus.parent, folder, flavour="native")
        return execute_unrecorded(prepare(loaded, cache))[0]

    return run


def unmet(outcome: Any) -> set[str]:
    return {name for name, met in outcome.assumptions.items() if not met}


# ---- words


def words_of_claims() -> set[str]:
    """Every text that the prover may write for the age of a delay: none stands elsewhere."""
    written = re.compile(r'"(?:any, however|constant, |sampled: |from least_age)')
    others = [x for x in Path(certificate.__file__).parent.glob("*.py") if x.stem != "words"]
    assert [x.name for x in others if written.search(x.read_text("utf-8"))] == []
    return {*hinf.certificate.AgeWord, AGE_FROM.format(least="1/2")}


@pytest.fixture(scope="module")
def acoustic(native_fmus: Path) -> Claims:
    return Claims(load("auv-direct", ["run.end=0.5"]), native_fmus)


def test_every_word_of_a_claim_has_a_rule(acoustic: Claims) -> None:
    """Of ages, kinds and guarantees: what has none would be claimed by nobody's decision."""
    words = words_of_claims()
    assert len(words) >= 7
    for word in words:
        assert "claim_known" not in acoustic.unmet(claiming(acoustic.design, age=word)), word
    fields = hinf.certificate.Guarantees.__dataclass_fields__
    named = with_claim(acoustic.design, guarantees={name: {} for name in fields})
    assert "claim_known" not in acoustic.unmet(named)


@pytest.mark.parametrize("name", ["auv-acoustic", "auv-acoustic-playout", "auv-remote"])
def test_the_kinds_of_certificates_are_known(fly: Fly, name: str) -> None:
    """An analysis, a proof for ages as they are, and one of an output feedback."""
    assert "claim_known" not in fly(name, "run.end=0.5").assumptions


def test_an_unknown_word_covers_nothing(acoustic: Claims) -> None:
    """Neither a held value nor a delay in a plant; and what is not known is named."""
    other = "any age, on weekdays"
    for at, apart in ((-1, "message_age_constant"), (0, "plant_as_designed")):
        found = acoustic.metrics(claiming(acoustic.design, at, age=other))
        assert found["assumptions"][apart] is False
        got = [one["got"] for one in found["departures"] if one["assumption"] == "claim_known"]
        assert got == [f"an age that is {other!r}"]
    found = acoustic.metrics(with_claim(acoustic.design, guarantees={"colour": {}}))
    assert found["assumptions"]["claim_known"] is False


PLANT = """
title = "Section 5"
connect = ["plant.x -> controller.x", "controller.u -> plant.u"]
[run]
end = 0.1
step = 0.1
[components.plant]
fmu = "DelayedPlant"
parameters = {{ "delay.d" = {} }}
[components.controller]
fmu = "PaperController"
[design]
file = "paper-printed-gain"
"""


@pytest.fixture(scope="module")
def plants(native_fmus: Path) -> dict[float, Claims]:
    """A loop with a delay in its plant, by the value that this has."""
    return {
        d: Claims(parse(PLANT.format(d), name="p", where="p", folder=Path()), native_fmus)
        for d in (0.0, 0.3, 1.0, 1.1)
    }


@pytest.mark.parametrize(
    ("word", "covered"),
    [
        ("any, however it varies, up to d", {0.0, 0.3, 1.0}),
        ("any, however it varies, from least_age to d", {0.3, 1.0}),
        ("from least_age to d, |age'| <= rate", {0.3, 1.0}),
        ("constant, up to d", {0.3, 1.0}),
        ("constant, exactly d", {1.0}),
        ("constant, from 1/2 to d", {1.0}),
        ("sampled: from least_age at rate one to d at most", set()),
    ],
)
def test_which_delays_of_a_plant_a_word_covers(
    word: str, covered: set[float], plants: dict[float, Claims]
) -> None:
    """Of a delay d = 1 with the least age 0.2."""
    least = 0.0 if word.endswith("any, however it varies, up to d") else 0.2
    found = set()
    for d, run in plants.items():
        claimed = claiming(run.design, d=1.0, any_age=True, least_age=least, age=word)
        apart = {(x["assumption"], x["place"]) for x in run.metrics(claimed)["departures"]}
        found |= set() if ("plant_as_designed", "plant.delay.d") in apart else {d}
    assert found == covered


# ---- a run


def test_a_run_with_an_observer_may_begin_later(fly: Fly) -> None:
    """Stamps are times of the components: the same ages, and the same verdict, from 100 s on.

    But for the envelope: there the path of set-points has ended, and the start is a step off it.
    """
    plain = fly("auv-remote", "run.end=20")
    later = fly("auv-remote", "run.start=100", "run.end=120")
    assert plain.claimed
    assert unmet(later) <= {"state_inside_envelope"}, later.departures
    ages = [one.metrics["measurement_ages"] for one in (plain, later)]
    for name in ages[0]:
        assert ages[0][name]["measured"] == ages[1][name]["measured"], name


def without_noise_and_sea() -> str:
    """`auv-remote` with the worst case of w in place of its sea, and sensors without noise."""
    library = files("cosim.scenario").joinpath("library", "auv-remote.toml")
    data = tomllib.loads(library.read_text("utf-8"))
    del data["components"]["sea"]
    data["connections"] = [c for c in data["connections"] if not c["from"].startswith("sea")]
    for sensor in ("telemetry", "usbl"):
        given = data["components"][sensor]["parameters"]
        given |= {name: 0.0 for name in given if name.startswith("noise")}
    worst = {"kind": "worst-case", "target": "plant.disturbance", "amplitude": 0.0005}
    data |= {"disturbance": worst, "run": {**data["run"], "end": 600.0}}
    return tomli_w.dumps(data)


def test_the_worst_case_of_w_acts_on_a_loop_with_an_observer(
    native_fmus: Path, tmp_path: Path
) -> None:
    """It did nothing, and said nothing: the gain comes close to the exact norm of the pair."""
    loaded = parse(without_noise_and_sea(), name="w", where="w.toml", folder=tmp_path)
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    outcome, _ = execute_unrecorded(prepare(loaded, cache))
    assert outcome.claimed, outcome.departures
    assert 0.995 < outcome.metrics["norm_reached"] < 1.0


LEFT = (
    ("auv-acoustic", "controller.force.x", 300.0, "controller_follows_law", 5.0),
    ("auv-acoustic", "plant.force.x", 300.0, "values_delivered", 5.0),
    ("auv-acoustic", "plant.nu.u", 1.0, "plant_follows_law", 5.0),
    ("auv-remote", "controller.thruster.surge", 300.0, "controller_follows_law", 5.0),
    ("auv-remote", "controller.innovation.usbl[1]", 1.0, "controller_follows_law", 5.0),
    ("auv-remote", "controller.estimate[1]", 1.0, "controller_follows_law", 5.0),
    ("auv-remote", "usbl.y[1]", 40.0, "measurements_true", None),  # too great on the whole
)
"""Scenario, what is overridden in it and by which value, the law that it leaves, and when."""


@pytest.mark.parametrize(("name", "place", "value", "law", "at_s"), LEFT)
def test_each_law_is_measured(
    name: str,
    place: str,
    value: float,
    law: str,
    at_s: float | None,
    native_fmus: Path,
    tmp_path: Path,
) -> None:
    """What is overridden is not by its law: by name, place and time, from the rows alone."""
    data = tomllib.loads(files("cosim.scenario").joinpath("library", f"{name}.toml").read_text())
    data["run"]["end"] = 15.0
    data["events"] = [{"at": 5.0, "for": 5.0, "override": {place: value}}]
    loaded = parse(tomli_w.dumps(data), name="w", where="w.toml", folder=tmp_path)
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    left = execute_unrecorded(prepare(loaded, cache))[0].departures[law]
    named = place.replace("usbl.y", "controller.usbl")
    assert (named, at_s) in {(one["place"], one.get("at_s")) for one in left}


def test_a_number_beside_the_design_is_refused(fly: Fly) -> None:
    """It was overwritten without a word."""
    with pytest.raises(InputError, match=r"K\[1,1\] is a number of the design"):
        fly("auv-acoustic", 'components.controller.parameters."K[1,1]"=-1.0')


def test_facts_under_the_verdict(fly: Fly) -> None:
    """Errors, what crosses which link, and that nothing has tried the bound."""
    outcome = fly("auv-acoustic", "run.end=5", "components.sea.parameters.Hs=0.0")
    facts = {fact.label: fact.text for fact in outcome.facts}
    assert "eta.x" in facts["error against the set-point at the end"]
    assert "the proof counts with its age" in facts["over uplink"]
    assert facts["gain of the zero-state run"].startswith("no disturbance acted")
    verdict = guarantee_of(outcome, assumptions_of(outcome))
    assert verdict is not None
    assert "was not exercised" in verdict.why


# ---- a contradiction


@pytest.fixture(scope="module")
def claimed(fly: Fly) -> Any:
    outcome = fly("auv-acoustic", "run.end=5")
    assert outcome.claimed
    assert outcome.contradiction is None
    return outcome


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"status": "diverged"}, "it diverged"),
        ({"metrics": {"gain": 3.4}}, "its gain is 3.4, above gamma = 3.36"),
        ({"metrics": {"state_growth": 101.0}}, "its state grew 101 times"),
    ],
)
def test_a_run_may_not_contradict_its_badge(
    claimed: Any, changed: dict[str, Any], words: str
) -> None:
    """Red in every view; with an assumption that is not met it contradicts nothing."""
    more = {"metrics": {**claimed.metrics, **changed.get("metrics", {})}}
    wrong = replace(claimed, **{**changed, **more})
    assert words in wrong.contradiction
    assert wrong.tone == "bad"
    assert "against its guarantee" in wrong.headline
    verdict = guarantee_of(wrong, assumptions_of(wrong))
    assert verdict is not None
    assert (verdict.tone, "report" in verdict.why) == ("bad", True)
    assert any(level == "error" for level, _, _ in wrong.conclusion)
    broken = {**wrong.metrics["assumptions"], "loop_as_designed": False}
    assert replace(wrong, metrics={**wrong.metrics, "assumptions": broken}).contradiction is None


def test_a_contradiction_has_an_exit_code_of_its_own(
    claimed: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """6, which asks for a report; of a run as it is, 0."""
    for outcome, code in ((claimed, 0), (replace(claimed, status="diverged"), 6)):
        monkeypatch.setattr("cosim.scenario.execute_run", lambda *_, it=outcome, **__: it)
        line = ("run", "auv-acoustic", "--set", "run.end=5", "--fmus", fmu_store("native"))
        assert cosim(*line, cwd=tmp_path).code == code


def test_a_file_that_fails_its_check_claims_nothing(native_fmus: Path, tmp_path: Path) -> None:
    """A trace of another content than its run wrote: `info` and the report say so."""
    loaded = load("auv-acoustic", ("run.end=5",))
    cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
    path = tmp_path / "a.mcap"
    execute_recorded(prepare(loaded, cache), path, supervision=supervision_of(loaded.scenario))
    whole = describe(path)
    assert whole["verified"] == {"verdict": "ok", "failed": []}
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    path.write_bytes(data)
    found = describe(path)
    assert found["verified"]["verdict"] == "failed"
    outcome = RunOutcome.from_json(whole["outcome"])
    verdict = guarantee_of(outcome, assumptions_of(outcome), found["verified"])
    assert verdict is not None
    assert verdict.tone == "bad"
    assert "fails its own check" in verdict.why
