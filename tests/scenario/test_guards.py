"""Conditions in the loop: where a run stops is the first row at which they hold, by its own rows.

The truth is NumPy over the rows of the same run without the condition; both engines, links whose
state is asked for, components with steps of their own, inputs that no move brings into the rows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import sampled

from cosim import open_session
from cosim.master import EngineName, Run
from cosim.scenario import FmuCache, execute_unrecorded, load, prepare

SCENARIO = """\
title = "A loop over two links"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu",
    "controller.force -> plant.force : down",
]

[run]
end = 20.0
step = 0.05
{algorithm}

[components.plant]
fmu = "AuvPlant"
parameters = {{ "initial.eta.x" = 1.0, "initial.eta.y" = -0.4, "initial.nu.u" = 0.5 }}

[components.controller]
fmu = "HinfController"
{step}

[links.up]
kind = "packet"
sample_time = "200 ms"
delay = "130 ms"
jitter = {{ kind = "uniform", width = "50 ms" }}
loss = 0.2

[links.down]
kind = "packet"
sample_time = "100 ms"
delay = "40 ms"
{more}
"""
STOP = """
[[events]]
when = "{condition}"
stop = true
"""
SIGNALS = (("plant", "eta.y"), ("plant", "force.y"), ("plant", "force.x"), ("controller", "eta.y"))
Signals = Callable[[str], Any]
CONDITIONS: dict[str, Callable[[Signals], Any]] = {
    "plant.eta.x < 0.1 m": lambda s: s("plant.eta.x") < 0.1,
    "abs(plant.eta.y) > 0.9 m or plant.eta.x < -0.05 m": lambda s: (
        (np.abs(s("plant.eta.y")) > 0.9) | (s("plant.eta.x") < -0.05)
    ),
    "not (plant.eta.x > 0.5 m) and t > 4.03 s": lambda s: (
        ~(s("plant.eta.x") > 0.5) & (s("t") > 4.03)
    ),
    "controller.eta.x < 0.7 m": lambda s: s("controller.eta.x") < 0.7,
    "plant.force.x >= controller.force.x and t > 3 s": lambda s: (
        (s("plant.force.x") >= s("controller.force.x")) & (s("t") > 3.0)
    ),
    "controller.nu.u != plant.nu.u and plant.eta.x < 0.9 m": lambda s: (
        (s("controller.nu.u") != s("plant.nu.u")) & (s("plant.eta.x") < 0.9)
    ),
    "up.age > 0.5 s": lambda s: s("up.age") > 0.5,
    "up.dropped >= 4 and down.age < 0.09 s": lambda s: (
        (s("up.dropped") >= 4) & (s("down.age") < 0.09)
    ),
    "hypot(plant.eta.x, plant.eta.y) < 0.3 m": lambda s: (
        np.hypot(s("plant.eta.x"), s("plant.eta.y")) < 0.3
    ),
    "max(plant.nu.u, plant.nu.v) < -0.1 m/s": lambda s: (
        np.maximum(s("plant.nu.u"), s("plant.nu.v")) < -0.1
    ),
    "floor(t / 0.7 s) == 5 and round(plant.eta.x / 1 m) <= 1": lambda s: (
        (np.floor(s("t") / 0.7) == 5) & (np.rint(s("plant.eta.x")) <= 1)
    ),
    "(plant.eta.x / (1 m)) ** 2 < 0.04": lambda s: s("plant.eta.x") * s("plant.eta.x") < 0.04,
    "0 / (plant.eta.x * 0) < 1 or t > 2 s": lambda s: s("t") > 2.0,  # nan is not less than one
    "min(0 / (plant.eta.x * 0), 0.5) < 1 or t > 2 s": lambda s: s("t") > 2.0,
    "min(0.5, 0 / (plant.eta.x * 0)) < 1 or t > 2 s": lambda s: s("t") > 2.0,
    "not min(0.5, 0 / (plant.eta.x * 0)) < 1 and t > 1 s": lambda s: s("t") > 1.0,
    "not max(0.5, 0 / (plant.eta.x * 0)) < 1 and t > 1 s": lambda s: s("t") > 1.0,
    "1 / (plant.eta.x * 0) > 1e300": lambda s: s("plant.eta.x") > 0.0,
    "plant.eta.x < 1 / 0 and t > 1 s": lambda s: s("t") > 1.0,  # numbers alone are IEEE 754 too
    "plant.eta.x < -1 / 0 or not plant.eta.x < 0 / 0 and t > 2 s": lambda s: s("t") > 2.0,
    "plant.eta.x < log(2, 1) and t > 1 s": lambda s: s("t") > 1.0,
    "plant.eta.x > 1e9 m": lambda s: s("plant.eta.x") > 1e9,  # never
}
LAYOUTS = {
    "plain": ("", ""),
    "slow controller": ("", "step = 0.1"),
    "gauss-seidel": ('algorithm = "gauss-seidel"', ""),
}


def run_of(text: str, fmus: Path, folder: Path, engine: EngineName) -> Run:
    """The run of a scenario, with its rows."""
    (folder / "s.toml").write_text(text)
    loaded = load(folder / "s.toml")
    prepared = prepare(loaded, FmuCache(fmus.parent, loaded.folder))
    _, run = execute_unrecorded(prepared, engine=engine, zero_state_run=False)
    return run


def signals_of(run: Run) -> Signals:
    """What the names of conditions are at every row."""

    def at(name: str) -> Any:
        if name == "t":
            return run.points_ns / 1e9
        first, _, rest = name.partition(".")
        if first in ("up", "down"):
            state = run.instances[0].comm_points.state(first, 0, run.count)
            return getattr(state, "age_s" if rest == "age" else rest)
        return run.signal(first, rest)

    return at


def of_levels(signals: Signals) -> dict[str, Callable[[Signals], Any]]:
    """Conditions that hold late: signals beyond all but a tenth of their values after 2 s."""
    made: dict[str, Callable[[Signals], Any]] = {}
    for name in ("plant.eta.y", "plant.force.x", "controller.eta.y", "controller.nu.u"):
        later = signals(name)[signals("t") > 2.0]
        for sign, share in ((">", 0.9), ("<", 0.1)):
            level = float(np.quantile(later, share))
            text = f"{name} {sign} {level!r} and t > 2 s"
            made[text] = partial(_is_beyond, name, sign, level)
    return made


def _is_beyond(name: str, sign: str, level: float, signals: Signals) -> Any:
    beyond = signals(name) > level if sign == ">" else signals(name) < level
    return beyond & (signals("t") > 2.0)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("engine", ["kernel", "python"])
def test_a_run_stops_at_the_first_row_at_which_the_condition_holds(
    layout: str, engine: EngineName, fmus: Path, tmp_path: Path
) -> None:
    """And its rows until there are those of the run without it."""
    algorithm, step = LAYOUTS[layout]

    def scenario(more: str) -> str:
        return SCENARIO.format(algorithm=algorithm, step=step, more=more)

    plain = run_of(scenario(""), fmus, tmp_path, engine)
    signals = signals_of(plain)
    stopped = 0
    for condition, truth in (CONDITIONS | of_levels(signals)).items():
        run = run_of(scenario(STOP.format(condition=condition)), fmus, tmp_path, engine)
        holds = np.flatnonzero(truth(signals))
        expected = int(holds[0]) + 1 if holds.size else plain.count
        assert run.count == expected, condition
        assert run.status == ("stopped" if holds.size else "finished"), condition
        stopped += bool(holds.size)
        for name in ("plant.eta.x", "controller.eta.x", "plant.force.x"):
            assert np.array_equal(signals_of(run)(name), signals(name)[: run.count]), condition
    assert stopped > len(CONDITIONS) // 2


MODES = """
[modes.m]
states = ["a", "b", "c"]
[[modes.m.transitions]]
from = "a"
to = "b"
when = "plant.eta.x < {first} m"
after = "{after} s"
[[modes.m.transitions]]
from = "b"
to = "c"
after = "0 s"
[[modes.m.transitions]]
from = "c"
to = "a"
after = "{back} s"
[modes.n.states.quiet]
[modes.n.states.pushed]
during = {{ bias = {{ "plant.force.x" = {{ offset = 0.2 }} }} }}
[[modes.n.transitions]]
to = "pushed"
from = "quiet"
after = "1.73 s"
[[modes.n.transitions]]
to = "quiet"
after = "0 s"
[[events]]
when = "m.a and m.time > {spent} s"
trigger = "every-time"
override = {{ "plant.force.y" = 3.0 }}
for = "0.3 s"
[[events]]
when = "plant.eta.y > {above} m"
ends = "plant.eta.y < {below} m or m.b"
trigger = "every-time"
bias = {{ "controller.eta.y" = {{ offset = 0.5 }} }}
loss = {{ up = 0.9 }}
"""


@pytest.mark.parametrize("seed", sampled(range(24), 4))
def test_what_conditions_do_is_the_same_however_they_are_looked_at(
    seed: int, fmus: Path, tmp_path: Path
) -> None:
    """Events that come again and end, modes that wait, links that change: guards, row by row."""
    drawn = np.random.default_rng(seed)
    names = ("first", "after", "back", "spent", "above", "below")
    high = (0.9, 2.0, 1.5, 1.0, 0.2, 0.0)
    low = (0.2, 0.0, 0.0, 0.0, -0.4, -0.5)
    numbers = dict(zip(names, drawn.uniform(low, high).round(3), strict=True))
    algorithm, step = [*LAYOUTS.values()][2 * (seed % 2)]
    text = SCENARIO.format(algorithm=algorithm, step=step, more=MODES.format(**numbers))
    one, other = (run_of(text, fmus, tmp_path, engine) for engine in ("kernel", "python"))
    # with a function to stop at, every row is looked at
    with open_session(tmp_path / "s.toml", fmus=fmus.parent, supervise=False) as session:
        session.run(stop=lambda _: False)
        looked_at = session.result()
    for each in (other, looked_at):
        assert each.count == one.count > 200
        for component, variable in SIGNALS:
            name = f"{component}.{variable}"
            assert np.array_equal(each.signal(component, variable), signals_of(one)(name)), name
