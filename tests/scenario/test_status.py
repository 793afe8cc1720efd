"""Limit cycle, steady saturation and decay are distinguished on runs with given commands.

A time series gives the reference of a designed controller, which makes its commands of it and
limits them; its plant stands apart. What is judged is the outcome.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

from cosim.master import Run
from cosim.models import TABLE_1, inertia
from cosim.scenario import (
    FmuCache,
    Outcome,
    execute_recorded,
    execute_unrecorded,
    parse,
    prepare,
    supervision_of,
)

S = 10**9
FORCE, MOMENT = 10.0, 4.0
AXIS = {"force.x": "x", "force.y": "y", "force.z": "z", "moment.z": "psi"}

SMOOTH_NS = [k * S // 10 for k in range(1000)]
T = np.array(SMOOTH_NS) / 1e9
SMOOTH = {
    "from limit to limit": (1000.0 * np.sin(T), True),
    "touches the limits less than half of the time": (1.3 * FORCE * np.sin(T), False),
    "stands at one limit": (np.where(T > 0.0, FORCE, 0.0), False),
    "decays": (1000.0 * np.sin(T) * np.exp(-T / 5.0), False),
    "just below the limits": (0.9999 * FORCE * np.sign(np.sin(T)), False),
    "ended before the last quarter": (np.where(T < 75.0, 1000.0 * np.sin(T), 0.0), False),
    "began in the last quarter": (np.where(T < 75.0, 0.0, 1000.0 * np.sin(T)), True),
    "one reversal": (np.sign(T) * np.where(T < 90.0, FORCE, -FORCE), False),
    "nothing": (0.0 * T, False),
}
"""Signals of force.x, and whether they are a limit cycle."""

BETWEEN_NS = [*range(2 * S + S // 100, 3 * S, S // 100), 70 * S - 1, 70 * S + 1]
"""Points beside those of the step, at which events do nothing that counts."""
STEPS_NS = sorted({*range(0, 81 * S, S), *BETWEEN_NS})
"""80 s, of which the last quarter begins at 60 s and has half of its 20 s until 70 s."""


def turning(times_ns: Sequence[int], size: float, pause_ns: int = 0) -> np.ndarray:
    """Command that alternates between the limits from each time to the next; else zero."""
    found = np.zeros(len(STEPS_NS))
    for k, (begin, end) in enumerate(pairwise(times_ns)):
        inside = [begin <= t < end - pause_ns * (k < len(times_ns) - 2) for t in STEPS_NS]
        found[inside] = size * (-1) ** k
    return found


def seconds(*times: int) -> list[int]:
    return [t * S for t in times]


STEPPED: dict[str, tuple[dict[str, np.ndarray], bool]] = {
    **{
        f"half of the quarter and {more} ns": (
            {"force.y": turning([*seconds(60, 62, 64, 66, 68), 70 * S + more], FORCE)},
            more > 0,
        )
        for more in (-1, 0, 1)
    },
    **{
        f"{n} reversals": (
            {"force.z": turning(seconds(*range(60, 60 + 3 * n + 1, 3), 80), FORCE, S)},
            n >= 4,
        )
        for n in (3, 4, 5)
    },
    "first of four reversals before the quarter": (
        {"force.x": turning(seconds(59, 60, 61, 62, 63, 80), FORCE)},
        False,
    ),
    "four reversals from its beginning": (
        {"force.x": turning(seconds(60, 61, 62, 63, 64, 80), FORCE)},
        True,
    ),
    "two commands with two reversals each": (
        {
            "force.x": turning(seconds(60, 62, 64, 70), FORCE),
            "moment.z": turning(seconds(70, 73, 76, 80), MOMENT),
        },
        False,
    ),
    "time at limits of two commands together": (
        {
            "force.x": turning(seconds(60, 67), FORCE),
            "moment.z": turning(seconds(67, 68, 69, 70, 71, 74), MOMENT),
        },
        True,
    ),
    "a second in a hundred points": ({"force.x": -turning(seconds(2, 3), FORCE)}, False),
    "a second in one point": ({"force.x": -turning(seconds(1, 2), FORCE)}, False),
}
"""Signals of commands, and whether they are a limit cycle."""


@cache
def named_gain() -> np.ndarray:
    """The gain of the design from positions to accelerations, (4, 4)."""
    designs = files("cosim.scenario").joinpath("library", "designs")
    K = json.loads(designs.joinpath("auv-1.25s.json").read_bytes())["K"]
    return np.array(K)[:, :4]


@dataclass(frozen=True)
class Judged:
    """What an outcome says of the commands of a run."""

    status: str
    fraction: float
    largest: Mapping[str, float]

    @classmethod
    def of(cls, outcome: Outcome) -> Judged:
        """That of an outcome."""
        metrics = outcome.metrics
        return cls(outcome.status, metrics["saturated_fraction"], metrics["largest_command"])


class Commander:
    """Runs a designed controller so that its commands at given points are given ones."""

    def __init__(
        self,
        cases: Mapping[str, Mapping[str, np.ndarray]],
        points_ns: Sequence[int],
        fmus: Path,
        folder: Path,
    ) -> None:
        self._cases, self._points, self._folder = cases, points_ns, folder
        self._step_ns = points_ns[1] - points_ns[0]
        self._cache = FmuCache(fmus.parent, folder, flavour="native")

    def judged(self, case: str, force: float = FORCE) -> Judged:
        """What is said of a run with these commands, however it is measured."""
        prepared = prepare(self._loaded(case, force), self._cache)
        outcome, run = execute_unrecorded(prepared, zero_state_run=False)
        self._check(run, self._cases[case], force)
        found = Judged.of(outcome)
        alone = supervision_of(prepared.loaded.scenario, supervise=False)
        path = self._folder / "status.mcap"  # recorded, and measured point by point
        _, again, _ = execute_recorded(
            prepared, path, engine="python", supervision=alone, zero_state_run=False
        )
        assert Judged.of(again) == found
        return found

    def stopped(self, case: str) -> Judged:
        """What is said of a run that is stopped where it would end."""
        stop = {"at": (self._points[-1] - 1) / 1e9, "stop": "enough"}
        prepared = prepare(self._loaded(case, FORCE, stop), self._cache)
        return Judged.of(execute_unrecorded(prepared, zero_state_run=False)[0])

    def _loaded(self, case: str, force: float, *events: dict[str, Any]) -> Any:
        commands = self._cases[case]
        wanted = np.zeros((len(self._points), len(AXIS)))
        for j, name in enumerate(AXIS):
            wanted[:, j] = commands.get(name, 0.0)
        assert not wanted[0].any()  # a controller starts with zero
        # u = K (x - reference) with x = 0; what it samples at a point it commands at the next one
        ahead = np.vstack([wanted[1:], wanted[-1:]])
        thrust = np.array(inertia(TABLE_1)) @ named_gain()
        references = -np.linalg.solve(thrust, ahead.T)
        points = {k * self._step_ns for k in range(len(self._points))}
        between = [t for t in self._points if t not in points]
        data = {
            "title": "commands that are given",
            "run": {"end": self._points[-1] / 1e9, "step": self._step_ns / 1e9},
            "components": {
                "plant": {"fmu": "AuvPlant"},
                "controller": {
                    "fmu": "HinfController",
                    "parameters": {
                        "limit.force": force,
                        "limit.moment": MOMENT,
                        "sample_time": 0.0,
                    },
                },
            },
            "design": {"file": "auv-1.25s"},
            "inputs": [
                {
                    "times": [t / 1e9 for t in self._points],
                    "values": {
                        f"controller.reference.{axis}": row.tolist()
                        for axis, row in zip(AXIS.values(), references, strict=True)
                    },
                    "interpolation": "hold",
                }
            ],
            "events": [
                *({"at": t / 1e9, "set": {"plant.disturbance.u": 0.0}} for t in between),
                *events,
            ],
        }
        return parse(tomli_w.dumps(data), name="s", where="s.toml", folder=self._folder)

    def _check(self, run: Run, commands: Mapping[str, np.ndarray], force: float) -> None:
        assert run.points_ns.tolist() == list(self._points)
        for name, wanted in commands.items():
            bound = MOMENT if name == "moment.z" else force
            made = run.signal("controller", name)
            np.testing.assert_allclose(made, np.clip(wanted, -bound, bound), rtol=0, atol=1e-9)


@pytest.fixture(scope="module")
def smooth(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Commander:
    cases = {name: {"force.x": command} for name, (command, _) in SMOOTH.items()}
    return Commander(cases, SMOOTH_NS, native_fmus, tmp_path_factory.mktemp("smooth"))


@pytest.fixture(scope="module")
def stepped(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Commander:
    cases = {name: given for name, (given, _) in STEPPED.items()}
    return Commander(cases, STEPS_NS, native_fmus, tmp_path_factory.mktemp("stepped"))


@pytest.mark.parametrize("case", SMOOTH)
def test_limit_cycle_is_distinguished_from_saturation(smooth: Commander, case: str) -> None:
    """A limit cycle goes to and fro between the limits, most of the last quarter."""
    assert smooth.judged(case).status == ("limit_cycle" if SMOOTH[case][1] else "finished")


@pytest.mark.parametrize("case", STEPPED)
def test_limit_cycle_begins_at_its_threshold(stepped: Commander, case: str) -> None:
    """More than half of the last quarter, four reversals of one command: at, below, above."""
    assert stepped.judged(case).status == ("limit_cycle" if STEPPED[case][1] else "finished")


def test_a_run_that_was_stopped_has_no_limit_cycle(smooth: Commander) -> None:
    """However near its end; the share of time at the limits is what it was."""
    found, whole = smooth.stopped("from limit to limit"), smooth.judged("from limit to limit")
    assert (found.status, whole.status) == ("stopped", "limit_cycle")
    assert found.fraction == pytest.approx(whole.fraction, rel=1e-3)
    assert found.largest == whole.largest


@pytest.mark.parametrize("case", ["a second in a hundred points", "a second in one point"])
def test_fraction_is_of_time_not_of_points(stepped: Commander, case: str) -> None:
    """One second at the limit in eighty, whatever the number of points in it."""
    found = stepped.judged(case)
    assert found.fraction == pytest.approx(1 / 80, rel=1e-12)
    expected = {"force.x": FORCE, "force.y": 0.0, "force.z": 0.0, "moment.z": 0.0}
    assert found.largest == pytest.approx(expected, abs=1e-9)


def test_limit_that_the_scenario_sets_counts(smooth: Commander) -> None:
    """The bound is the parameter of the run, not the FMU's default."""
    assert smooth.judged("stands at one limit", 2 * FORCE).fraction == 0.0
    assert smooth.judged("stands at one limit").fraction == pytest.approx(998 / 999)
