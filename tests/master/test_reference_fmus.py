"""Modelica's Reference FMUs of FMI 3.0 against their reference results, where they are at hand.

COSIM_REFERENCE_FMUS names a folder with NAME.fmu and NAME_out.csv, as the project releases them.
"""

from __future__ import annotations

import csv
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.fmu import describe_fmu
from cosim.master import Component, Run, Session, System, make_schedule

FOLDER = Path(os.environ.get("COSIM_REFERENCE_FMUS", "none"))
EXPERIMENTS = {
    "BouncingBall": (0.01, 3.0),
    "Clocks": (1.0, 10.0),
    "Dahlquist": (0.1, 10.0),
    "Feedthrough": (0.1, 2.0),
    "Resource": (0.1, 1.0),
    "Stair": (0.2, 10.0),
    "StateSpace": (1.0, 10.0),
    "VanDerPol": (0.01, 20.0),
}
"""Name -> communication step and end [s] of the reference results."""


def run_of(name: str, **options: Any) -> Run:
    """The default experiment."""
    if not (FOLDER / f"{name}.fmu").is_file():
        pytest.skip("needs the Reference FMUs: COSIM_REFERENCE_FMUS names their folder")
    step, end = EXPERIMENTS[name]
    component = Component(describe_fmu(FOLDER / f"{name}.fmu"), **options)
    schedule = make_schedule({}, round(step * 1e9), round(end * 1e9), "align")
    with Session(System({"it": component}, [], {}, {}, schedule)) as session:
        session.run_until()
        return session.result(complete=True)


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name != "Clocks"])
def test_reference_fmu_gives_its_reference_result(name: str) -> None:
    """With event mode where it has one, to the last digit that the file has."""
    run = run_of(name)
    assert run.status == ("stopped" if name == "Stair" else "finished"), run.reason
    with (FOLDER / f"{name}_out.csv").open(newline="") as file:
        header, *rows = list(csv.reader(file))
    instance = run.instances[0]
    compared = 0
    for row in rows:
        k = int(np.searchsorted(run.points_ns, round(float(row[0]) * 1e9), side="right")) - 1
        assert run.points_ns[k] == round(float(row[0]) * 1e9)
        columns = instance.output_columns
        values = dict(
            zip(
                (c.name for c in columns),
                instance.values(instance.outputs[k : k + 1], columns)[0],
                strict=True,
            )
        )
        for variable, text in zip(header[1:], row[1:], strict=True):
            parts = text.split(" ") if variable not in values else [text]
            for i, part in enumerate(parts, 1):
                value = values[variable if variable in values else f"{variable}[{i}]"]
                if isinstance(value, bool):
                    assert str(value).lower() == part
                elif isinstance(value, str):
                    assert value == part
                else:
                    assert value == pytest.approx(float(part), rel=1e-12, abs=1e-12)
                compared += 1
    assert compared >= len(rows)


def test_bounces_come_when_the_equation_says() -> None:
    """h = 1 - g t^2 / 2, and e times the speed after each bounce; the FMU looks every 1 ms."""
    run = run_of("BouncingBall")
    g, e, speed = 9.81, 0.7, np.sqrt(2 * 9.81)
    bounces, t = [], speed / g
    while speed > 0.3:
        bounces.append(t)
        speed *= e
        t += 2 * speed / g
    v = run.signal("it", "v")
    jumps = run.points_ns[np.flatnonzero(np.diff(v) > 0.3)] / 1e9
    np.testing.assert_allclose(jumps[:4], bounces[:4], atol=0.02)  # 1 ms late each, and slower
    assert jumps[0] == pytest.approx(bounces[0], abs=0.002)


def test_clocks_activate_their_model_partitions() -> None:
    """The Reference FMU Clocks, for scheduled execution: as the table in its source says."""
    run = run_of("Clocks", clocks={"inClock2": [0.0, 1.0, 8.0, 9.0]})
    assert run.status == "finished", run.reason

    def ticks(clock: str) -> list[float]:
        return (run.points_ns[np.flatnonzero(run.signal("it", clock))] / 1e9).tolist()

    assert ticks("inClock1") == [float(t) for t in range(11)]
    assert ticks("inClock2") == [0.0, 1.0, 8.0, 9.0]
    assert ticks("inClock3") == [4.0]
    last = {name: run.signal("it", name)[-1] for name in ("inClock1Ticks", "inClock2Ticks")}
    assert last == {"inClock1Ticks": 11.0, "inClock2Ticks": 4.0}
    assert run.signal("it", "inClock3Ticks")[-1] == 1.0
    assert run.signal("it", "totalInClockTicks")[-1] == 16.0
    assert run.signal("it", "output3")[-1] == 1000.0
