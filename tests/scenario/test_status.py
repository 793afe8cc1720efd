"""Limit cycle, steady saturation and decay are distinguished on runs with given commands.

A table of signals, as an FMU, gives the reference; the vehicle's controller, an FMU too, makes
its commands of it and limits them. What is judged is the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fed import blocks_of_one, fed

from cosim.fmu import build_fmu, component_module, describe_fmu
from cosim.master import Component, Connection, Endpoint, Run, System, make_schedule, simulate
from cosim.models import STATE
from cosim.scenario.limits import Saturation, measured_saturation
from cosim.scenario.measure import measured

S = 10**9
FORCE, MOMENT = 10.0, 4.0
AXIS = {"force.x": "x", "force.y": "y", "force.z": "z", "moment.z": "psi"}
AS_COMMANDED = {f"K[{i},{j}]": -float(i == j) for i in range(1, 5) for j in range(1, 9)} | {
    f"thrust_map[{i},{j}]": float(i == j) for i in range(1, 5) for j in range(1, 5)
}
"""u = K (x - reference) with x = 0: each command is the reference of its axis."""

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

STEPS_NS = sorted({*range(0, 81 * S, S), *range(2 * S, 3 * S, S // 1000), 70 * S - 1, 70 * S + 1})
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
    "a second in a thousand points": ({"force.x": -turning(seconds(2, 3), FORCE)}, False),
    "a second in one point": ({"force.x": -turning(seconds(1, 2), FORCE)}, False),
}
"""Signals of commands, and whether they are a limit cycle."""


class Commander:
    """Runs the controller so that its commands at given points are given ones."""

    def __init__(
        self,
        cases: Mapping[str, Mapping[str, np.ndarray]],
        points_ns: Sequence[int],
        fmus: Path,
        folder: Path,
    ) -> None:
        self._cases, self._points = cases, points_ns
        pairs = [(case, name) for case, given in cases.items() for name in given]
        self._names = {pair: f"command{number}" for number, pair in enumerate(pairs)}
        values = np.column_stack([x for given in cases.values() for x in given.values()])
        assert not values[0].any()  # a controller starts with zero
        # what it samples at a point it commands at the next one
        ahead = [*values[1:].tolist(), values[-1].tolist()]
        outputs = [(name, None) for name in self._names.values()]
        spec = component_module("signal_table.variables").table_spec(
            "Table", outputs, points_ns, ahead, 1.0
        )
        self._table = describe_fmu(build_fmu(spec, folder, "native"))
        self._controller = describe_fmu(fmus / "HinfController.fmu")

    def judged(self, case: str, force: float = FORCE) -> Saturation:
        """Saturation of a run with these commands."""
        start = dict.fromkeys(STATE, 0.0) | {"limit.force": force, "limit.moment": MOMENT}
        start |= AS_COMMANDED | {"sample_time": 0.0}
        end = self._points[-1]
        commands = self._cases[case]
        run = simulate(
            System(
                {"table": Component(self._table), "controller": Component(self._controller, start)},
                [
                    Connection(
                        Endpoint("table", self._names[case, name]),
                        Endpoint("controller", f"reference.{AXIS[name]}"),
                    )
                    for name in commands
                ],
                {},
                {},
                make_schedule({}, end, end, "align", (), self._points),
                1e9,
            )
        )
        self._check(run, commands, force)
        found = measured(run, measured_saturation("controller"))
        assert found is not None
        again = fed(run, [measured_saturation("controller")], blocks_of_one(run.points_ns.size))
        assert again == [found]
        broken_off = measured(replace(run, status="stopped"), measured_saturation("controller"))
        assert broken_off == replace(found, limit_cycle=False)
        return found

    def _check(self, run: Run, commands: Mapping[str, np.ndarray], force: float) -> None:
        assert run.points_ns.tolist() == list(self._points)
        for name, wanted in commands.items():
            bound = MOMENT if name == "moment.z" else force
            made = run.signal("controller", name)
            assert made.tolist() == np.clip(wanted, -bound, bound).tolist()


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
    assert smooth.judged(case).limit_cycle is SMOOTH[case][1]


@pytest.mark.parametrize("case", STEPPED)
def test_limit_cycle_begins_at_its_threshold(stepped: Commander, case: str) -> None:
    """More than half of the last quarter, four reversals of one command: at, below, above."""
    assert stepped.judged(case).limit_cycle is STEPPED[case][1]


@pytest.mark.parametrize("case", ["a second in a thousand points", "a second in one point"])
def test_fraction_is_of_time_not_of_points(stepped: Commander, case: str) -> None:
    """One second at the limit in eighty, whatever the number of points in it."""
    found = stepped.judged(case)
    assert found.fraction == pytest.approx(1 / 80, rel=1e-12)
    assert found.largest == {"force.x": FORCE, "force.y": 0.0, "force.z": 0.0, "moment.z": 0.0}


def test_limit_that_the_scenario_sets_counts(smooth: Commander) -> None:
    """The bound is the parameter of the run, not the FMU's default."""
    assert smooth.judged("stands at one limit", 2 * FORCE).fraction == 0.0
    assert smooth.judged("stands at one limit").fraction == pytest.approx(998 / 999)
