"""Proofs for ages that nothing has which is hold: named, and the same gains proved for any age."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim

from cosim.core import PLANT_NOTE, InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, Result, check_certificate, design, design_output_feedback
from cosim.hinf.certificate import (
    constant_ages_claimed,
    remark_on_ages,
    reproving_command,
    standalone,
)
from cosim.hinf.synthesis import proved_again
from cosim.models import Measurement

OSCILLATOR = np.array([[0.0, 1.0], [-2.0, 0.1]])
"""Unstable without control."""
AXIS: dict[str, Any] = {
    "B": [[0], [1]],
    "C": [[0], [1]],
    "D": [[1.0, 0.0], [0.0, 0.0]],
    "D2": [[0.0], [0.1]],
}
LATE = """
[system]
A = [[0.0, 1.0], [-2.0, 0.1]]
A1 = [[0.0, 0.0], [1.0, 0.0]]
d = 1.0
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [0.1]]

[[measurements]]
name = "position"
states = [1]
d = 0.2

[observer]
K = [[0.0, -0.02]]
L = { position = [[0.3], [0.0]] }
"""
"""A plant with a delay inside; a position of any age; commands at once: an old claim."""


def old_claim() -> Result:
    """The design of `LATE`."""
    plant = DelaySystem(OSCILLATOR, **AXIS, delays=[Delay(1.0, [[0, 0], [1, 0]])], name="late")
    position = Measurement("position", [[1, 0]], 0.2, any_age=True)
    gains: dict[str, Any] = {"gain": [[0, -0.02]], "injections": [[[0.3], [0]]]}
    return design_output_feedback(plant, [position], **gains)


def integrators(*delays: Delay, **more: Any) -> DelaySystem:
    """Position and speed."""
    return DelaySystem([[0, 1], [0, -0.1]], **AXIS, delays=delays, **more)


def link(**kind: Any) -> Delay:
    """Feedback half a second late."""
    return Delay(0.5, np.zeros((2, 2)), feedback=True, **kind)


K = np.array([[-0.2086, -1.056]])


@pytest.mark.parametrize(
    ("system", "ages"),
    [
        pytest.param(integrators(link()), {"feedback": 0.5}, id="constant"),
        pytest.param(integrators(), {"feedback": 0.0}, id="at once"),
        pytest.param(integrators(link(any_age=True, rate=0.1)), {"feedback": 0.5}, id="continuous"),
        pytest.param(integrators(link(any_age=True)), {}, id="any"),
        pytest.param(integrators(link(least_age=0.2, sampled=True)), {}, id="sampled"),
        pytest.param(
            integrators(Delay(0.3, np.diag([0.0, -0.1])), link(any_age=True)),
            {},
            id="inside the plant",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_ages_of_a_feedback_that_no_run_has_are_named(
    system: DelaySystem, ages: dict[str, float]
) -> None:
    """A delay inside the plant may be constant; feedback may not, nor one without a delay."""
    found = design(system, gain=K)
    assert constant_ages_claimed(found.certificate) == ages
    remark = remark_on_ages(found.certificate)
    assert (remark is None) == (not ages)
    assert all(name in str(remark) for name in ages)
    again = proved_again(found, hold=0.05)
    assert constant_ages_claimed(again.certificate) == {}
    np.testing.assert_array_equal(again.K, found.K)
    own = [x for x in again.system.delays if not x.feedback]
    assert [x.d for x in own] == [x.d for x in system.delays if not x.feedback]


@pytest.mark.slow
def test_ages_of_a_pair_are_named_by_measurement_and_command() -> None:
    """Each by itself; one that says nothing of a gain has none."""
    plant = integrators()
    position = Measurement("position", [[1, 0]], 0.2, any_age=True)
    speed = Measurement("speed", [[0, 1]], 0.1)
    gains: dict[str, Any] = {"gain": K, "injections": [[[0.5], [0.1]], [[0.1], [0.5]]]}

    def ages(*measured: Measurement, **more: Any) -> dict[str, float]:
        found = design_output_feedback(plant, measured, **gains, order=0, quick=True, **more)
        return constant_ages_claimed(found.certificate)

    varies: dict[str, Any] = {"command_age": 0.1, "command_any_age": True}
    assert ages(position, speed) == {"speed": 0.1, "commands": 0.0}
    assert ages(position, replace(speed, d=0.0), **varies) == {"speed": 0.0}
    assert ages(position, speed, command_age=0.1) == {"speed": 0.1, "commands": 0.1}
    assert ages(position, replace(speed, least_age=0.05, sampled=True), **varies) == {}
    assert constant_ages_claimed({"kind": "norm", "claim": {}}) == {}


@pytest.mark.slow
def test_an_old_pair_is_proved_again_with_its_own_gains() -> None:
    """K, L, the plant and its delay stay; commands get any age; both checkers prove it."""
    old = old_claim()
    before = json.dumps(old.to_json())
    assert constant_ages_claimed(old.certificate) == {"commands": 0.0}
    with pytest.raises(InputError, match="commands"):
        proved_again(old)
    with pytest.raises(InputError, match="not an age"):
        proved_again(old, hold=0.0)
    noted = replace(old, certificate={**old.certificate, PLANT_NOTE: {"model": "mine"}})
    new = proved_again(noted, hold=0.05)
    assert new.observer is not None
    np.testing.assert_array_equal(new.K, old.K)
    np.testing.assert_array_equal(new.L[0], old.L[0])
    assert new.certificate[PLANT_NOTE] == {"model": "mine"}
    assert [(x.d, x.any_age) for x in new.pair.system.delays] == [
        *((1.0, False), (0.05, True), (0.2, True))
    ]
    own = {**new.certificate}
    del own[PLANT_NOTE]
    assert check_certificate(own).valid
    assert standalone.check(json.dumps(own).encode())["observer"]["command_any_age"] is True
    assert check_certificate(old.certificate).valid  # the old claim is true, and read as ever
    assert json.dumps(old.to_json()) == before


def test_gains_that_need_an_old_measurement_are_not_proved_for_a_younger_one() -> None:
    """Stable with a position of exactly 1 s; at once the error grows, by its eigenvalues."""
    plant = DelaySystem(OSCILLATOR, **AXIS, name="win")
    L = np.array([[0.0], [-1.0]])
    gains: dict[str, Any] = {"gain": [[0, -1.1]], "injections": [L]}
    old = design_output_feedback(plant, [Measurement("position", [[1, 0]], 1.0)], **gains)
    assert np.linalg.eigvals(OSCILLATOR - L @ [[1.0, 0.0]]).real.max() > 0
    with pytest.raises(NotAchievableError):
        proved_again(old, hold=0.05)


@pytest.mark.slow
def test_the_command_of_a_certificate_proves_it_again(tmp_path: Path) -> None:
    """What the verb stores is read as a design, and asks for no command any more."""
    text = LATE.replace("[observer]", "[observer]\ncommand_age = 0")
    (tmp_path / "late.toml").write_text(text, "utf-8")
    made = cosim("design", "late.toml", "--save", "my late.json", cwd=tmp_path)
    assert "no run can claim it" in " ".join(made.out.split())
    path = tmp_path / "my late.json"
    data = json.loads(path.read_bytes())
    command = reproving_command(data, "my late.json", hold=0.05)
    assert command == ("cosim certificate prove 'my late.json' --hold 0.05 --save 'my late.json'")
    answer = cosim(*shlex.split(command)[1:], "--json", cwd=tmp_path)
    assert answer.code == 0, answer.err
    assert answer.json["gamma_before"] == pytest.approx(1.2185, abs=1e-3)
    assert answer.json["constant_ages_claimed"] == {}
    assert answer.json["K"] == data["K"]
    found = Result.from_json(json.loads(path.read_bytes()), where="late.json")
    assert reproving_command(found.certificate, "late.json") is None
    missing = cosim("certificate", "prove", "my late.json", cwd=tmp_path)
    assert missing.code == 0, "nothing acts at once any more"


def test_the_command_replaces_no_fmu_and_no_kept_design() -> None:
    """These hold more than a design, or belong to a scenario."""
    data = old_claim().to_json()
    words = "cosim certificate prove {} --hold SECONDS --save {}"
    for where, target in (
        ("out/gain.json", "out/gain.json"),
        ("controller.fmu", "controller-held.json"),
        ("mine.design.json", "mine-held.json"),
        ("flight.mcap", "flight-held.json"),
    ):
        assert reproving_command(data, where) == words.format(where, target)
    constant = design(integrators(link()), gain=K).certificate
    assert reproving_command(constant, "k.json") == "cosim certificate prove k.json --save k.json"


def test_the_verb_names_guarantees_that_it_does_not_prove_again(tmp_path: Path) -> None:
    """A rate of decay of the old proof is about its own ages."""
    found = design(integrators(link()), gain=K, decay=0.05)
    (tmp_path / "k.json").write_text(json.dumps(found.certificate), "utf-8")
    answer = cosim("certificate", "prove", "k.json", cwd=tmp_path)
    assert "not proved again: decay" in answer.out, answer.err
    refused = cosim("certificate", "prove", "k.json", "--order", "two", cwd=tmp_path)
    assert (refused.code, "--order" in refused.err) == (2, True)


@pytest.mark.slow
def test_commands_of_a_new_design_are_of_any_age_where_that_costs_little(tmp_path: Path) -> None:
    """Both checkers prove it; a file that says at once keeps its claim, and the remark."""
    file = tmp_path / "late.toml"
    file.write_text(LATE, "utf-8")
    seen = cosim("design", "late.toml", "--save", "late.json", "--json", cwd=tmp_path)
    assert seen.code == 0, seen.err
    assert (seen.json["command_any_age"], seen.json["constant_ages_claimed"]) == (True, {})
    assert 0.0 < seen.json["command_age"] <= 0.1
    data = json.loads((tmp_path / "late.json").read_text("utf-8"))
    assert check_certificate(data).valid
    own = {key: data[key] for key in data if key not in ("schema", "figures")}
    assert standalone.check(json.dumps(own).encode())["observer"]["command_any_age"] is True
    file.write_text(LATE.replace("[observer]", "[observer]\ncommand_age = 0"), "utf-8")
    seen = cosim("design", "late.toml", "--json", cwd=tmp_path)
    assert seen.json["constant_ages_claimed"] == {"commands": 0.0}
