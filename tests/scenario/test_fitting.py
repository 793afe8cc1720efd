"""What fits of FMUs: hundreds of random ones, beside the rule written from its words alone."""

from __future__ import annotations

import random
from pathlib import Path

import pytest
from described_pairs import TYPES, random_model, written
from truth.wiring import wires_of

from cosim.fmu import describe_fmu
from cosim.scenario import fitting_of, scenario_from_fmus

SEEDS = 400


def test_random_fmus_are_wired_as_the_rule_says(tmp_path: Path) -> None:
    """Two or three FMUs of any version: exactly what fits, with gain and offset, is wired."""
    seen = {"wires": 0, "open": 0, "converted": 0, "by terminal": 0, "several": 0}
    for seed in range(SEEDS):
        draw = random.Random(seed)  # noqa: S311 - cases, not secrets
        models, described = {}, {}
        for k in range(draw.choice([2, 2, 3, 3])):
            version = draw.choice(list(TYPES))
            models[f"c{k}"] = random_model(draw, version)
            path = written(models[f"c{k}"], version, tmp_path / f"{seed}-{k}.fmu")
            described[f"c{k}"] = describe_fmu(path)
        expected, left = wires_of(models)
        found = fitting_of(described)
        wires = [(str(w.source), str(w.target), w.gain, w.offset) for w in found.wires]
        assert [wire[:2] for wire in wires] == [wire[:2] for wire in expected], seed
        for mine, theirs in zip(wires, expected, strict=True):
            assert mine[2:] == pytest.approx(theirs[2:], rel=1e-14), seed
        assert [str(one.target) for one in found.open_inputs] == left, seed
        seen["wires"] += len(wires)
        seen["open"] += len(left)
        seen["converted"] += sum(w.converted is not None for w in found.wires)
        seen["by terminal"] += sum(w.source.variable != w.target.variable for w in found.wires)
        seen["several"] += sum("outputs fit" in one.why for one in found.open_inputs)
    assert min(seen.values()) >= 20, seen


def test_every_random_scenario_is_one_that_a_run_takes(tmp_path: Path) -> None:
    """The check finds nothing but that these FMUs have no binaries."""
    for seed in range(60):
        draw = random.Random(10_000 + seed)  # noqa: S311 - cases, not secrets
        paths = []
        for k in range(draw.choice([2, 3])):
            version = draw.choice(list(TYPES))
            model = random_model(draw, version)
            paths.append(written(model, version, tmp_path / f"{seed}-{k}.fmu"))
        link = draw.choice([None, "modem"])
        made = scenario_from_fmus("mine", paths, folder=tmp_path, link=link)
        assert len(made.problems) == len(paths), made.text
        assert all("no binary" in str(one.got) for one in made.problems), made.text
