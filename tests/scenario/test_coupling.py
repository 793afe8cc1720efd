"""Coupling delay and measurement age under every algorithm and policy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from master.coupled import rewritten

LOOP = """\
title = "Section 5, its gain"

[run]
end = 2.0
step = 0.1
RUN

[components.plant]
fmu = "DelayedPlant"
PLANT

[components.controller]
fmu = "PaperController"
CONTROLLER
parameters = { sample_time = 0.0 }

[[connections]]
from = "plant.x"
to = "controller.x"
UP

[[connections]]
from = "controller.u"
to = "plant.u"

[links.up]
kind = "transport"
delay = 0.3

[design]
system = "paper"
gain = [[0.6432, -0.5679]]
k1 = [0.6]
k2 = [0.2]
"""
SEIDEL = 'algorithm = "gauss-seidel"\norder = '


def metrics(fmus: Path, folder: Path, **parts: str) -> Any:
    text = LOOP
    for key in ("RUN", "PLANT", "CONTROLLER", "UP"):
        text = text.replace(f"\n{key}\n", f"\n{parts.get(key, '')}\n")
    (folder / "s.toml").write_text(text)
    result = cosim("run", "s.toml", "--json", "--fmus", fmus.parent, cwd=folder)
    assert result.code == 0, result.err
    return result.json["metrics"]


UP, DOWN, LINK = "plant -> controller", "controller -> plant", "plant -> controller over up"
PLANT_FIRST = SEIDEL + '["plant", "controller"]'
CONTROLLER_FIRST = SEIDEL + '["controller", "plant"]'


@pytest.mark.parametrize(
    ("parts", "age", "delays"),
    [
        # Jacobi: one step to compute, one to hold
        ({}, 0.2, 0.1),
        # whoever steps second sees what the first has reached
        ({"RUN": PLANT_FIRST}, 0.1, {UP: 0.0, DOWN: 0.1}),
        ({"RUN": CONTROLLER_FIRST}, 0.1, {UP: 0.1, DOWN: 0.0}),
        # a slow controller: three steps to compute, three to hold
        ({"CONTROLLER": "step = 0.3"}, 0.6, {UP: 0.3, DOWN: 0.3}),
        # a slow plant: sampled by the controller 0.3 s long, and its own hold
        ({"PLANT": "step = 0.3"}, 0.6, {UP: 0.3, DOWN: 0.3}),
        # the link's 0.3 s come on top of the age and are no part of the coupling
        ({"UP": 'link = "up"'}, 0.5, 0.1),
        ({"UP": 'link = "up"', "RUN": PLANT_FIRST}, 0.5, {LINK: 0.1, DOWN: 0.1}),
    ],
)
def test_age_and_coupling_by_hand(
    parts: dict[str, str], age: float, delays: Any, fmus: Path, tmp_path: Path
) -> None:
    """Counted in steps of 0.1 s by hand."""
    found = metrics(fmus, tmp_path, **parts)
    assert found["message_age_s"] == pytest.approx(age)
    if isinstance(delays, dict):
        assert found["coupling_delays_s"] == pytest.approx(delays)
        assert found["coupling_delay_s"] == pytest.approx(max(delays.values()))
    else:
        assert found["coupling_delay_s"] == pytest.approx(delays)


def test_undeclared_dependencies_make_no_measurement_younger(fmus: Path, tmp_path: Path) -> None:
    """A controller that may compute in its step: the age is that of one that does."""
    rewritten(
        fmus / "PaperController.fmu",
        tmp_path / "quiet.fmu",
        (r'(<Outputs>\s*<Unknown index="\d+") dependencies="[^"]*"', r"\1"),
    )
    text = LOOP.replace('fmu = "PaperController"', f'fmu = "{tmp_path / "quiet.fmu"}"')
    for key in ("RUN", "PLANT", "CONTROLLER", "UP"):
        text = text.replace(f"\n{key}\n", "\n\n")
    (tmp_path / "s.toml").write_text(text)
    result = cosim("run", "s.toml", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["metrics"]["message_age_s"] == pytest.approx(0.2)
