"""A controller with integral action in runs: no steady error, no windup, the same bits twice."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim import Trace, run
from cosim.fmu.export import FmuTarget, export_controller, export_plant
from cosim.hinf import design, system_by_name
from cosim.hinf.problem import with_integral

SYSTEM = """
[system]
A = [[0.0, 1.0], [0.0, -0.2]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[0.3, 0.0], [0.0, 0.0]]
D2 = [[0.0], [1.0]]
[[system.delays]]
d = 0.5
feedback = true
"""

SCENARIO = """
title = "A gust"
[run]
end = "{end} s"
step = "20 ms"
[components.plant]
fmu = "plant.fmu"
[components.controller]
fmu = "{controller}"
parameters = {{ {parameters} }}
[[connections]]
from = "plant.x"
to = "controller.x"
link = "uplink"
[[connections]]
from = "controller.u"
to = "plant.u"
[links.uplink]  # exchange and hold add a step each: 0.5 s in all
kind = "transport"
delay = 0.46
[[events]]
at = "1 s"
{until}
set = {{ "plant.w[1]" = {gust} }}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make the plant, and the controller in both flavours, limited to 0.6."""
    made = tmp_path_factory.mktemp("integral")
    (made / "axis.toml").write_text(SYSTEM)
    system = system_by_name(str(made / "axis.toml")).system
    gain = [[-0.5436, -1.2316, -0.0656]]
    data = (design(with_integral(system, [0]), gain=gain, order=1)).to_json()
    export_plant(str(made / "axis.toml"), made / "plant.fmu", kind=FmuTarget("native"), name="P")
    for flavour in ("native", "python"):
        export_controller(
            data,
            made / f"{flavour}.fmu",
            where="test",
            kind=FmuTarget(flavour),
            name="C",
            limits=[0.6],
        )
    return made


def run_with(folder: Path, gust: float, **settings: Any) -> dict[str, np.ndarray]:
    """Run with a gust, and return position, command and integral over time."""
    given = {"controller": "native.fmu", "end": 120, "until": "", "parameters": ""} | settings
    file = folder / "run.toml"
    file.write_text(SCENARIO.format(gust=gust, **given))
    run(file, folder / "run.mcap", supervise=False)
    trace = Trace(folder / "run.mcap")
    return {
        name: np.asarray(trace[signal].values)
        for name, signal in (
            ("x", "plant.x[1]"),
            ("u", "controller.u[1]"),
            ("xi", "controller.xi[1]"),
            ("seen", "controller.x[1]"),
        )
    }


@pytest.mark.slow
def test_a_constant_disturbance_leaves_no_error(folder: Path) -> None:
    """The command ends at what the disturbance needs, and the position at zero."""
    found = run_with(folder, 0.4)
    assert np.abs(found["x"]).max() > 0.3
    assert np.abs(found["x"][-500:]).max() < 1e-3
    assert found["u"][-1] == pytest.approx(-0.4, abs=1e-3)
    # what is received, held for a step each
    sums = np.concatenate([[0.0], np.cumsum(0.02 * found["seen"])])
    assert np.abs(sums[: len(found["xi"])] - found["xi"]).max() < 1e-9


@pytest.mark.slow
def test_saturation_does_not_wind_the_integral_up(folder: Path) -> None:
    """After a disturbance beyond the limit the integral is back sooner than without the rule."""
    short = {"until": 'for = "15 s"', "end": 100}
    kept = run_with(folder, 0.75, **short)
    free = run_with(folder, 0.75, **short, parameters='"anti_windup[1,1]" = 0.0')
    assert np.abs(kept["u"]).max() == 0.6
    assert np.abs(kept["xi"]).max() < 0.5 * np.abs(free["xi"]).max()
    # how far it goes beyond the other side
    assert -kept["x"].min() < 0.6 * -free["x"].min()


@pytest.mark.slow
def test_both_flavours_have_the_same_bits(folder: Path) -> None:
    """Native and Python integrate alike, inside the limits and at them, at any sample time."""
    for sample_time in (0.0, 0.05):
        runs = [
            run_with(
                folder,
                0.75,
                controller=f"{flavour}.fmu",
                end=20,
                parameters=f"sample_time = {sample_time}",
            )
            for flavour in ("native", "python")
        ]
        for name in runs[0]:
            assert np.array_equal(runs[0][name], runs[1][name])
