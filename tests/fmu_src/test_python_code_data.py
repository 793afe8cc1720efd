"""The shell of Python code that a wheel brings: a binary that reads its names."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from wheel import tape_fmu

from cosim import Component, Scenario, run
from cosim.fmu import code_of
from cosim.fmu.export import component_module


class Sum(Component):
    """y is the running sum of x."""

    inputs, outputs = {"x": 2}, {"y": 1}

    def start(self, t: float) -> None:  # noqa: ARG002
        self.total = 0.0

    def step(self, t: float, dt: float, u: Any) -> Any:  # noqa: ARG002
        self.total += float(u["x"].sum())
        return {"y": self.total}


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_it_calls_the_code_as_a_compiled_one_does(version: str, tmp_path: Path) -> None:
    spec = component_module("python_code.variables").python_code_spec("total", {"x": 2}, {"y": 1})
    total = Sum()
    shell = tape_fmu(spec, "python_code", tmp_path, version)
    inputs = {"x[1]": 1.0, "x[2]": 0.5, **code_of(total).parameters}
    read = Scenario(step=0.1, until=1).add("total", shell, parameters=inputs)
    compiled = Scenario(step=0.1, until=1).add(
        "total", total, parameters={"x[1]": 1.0, "x[2]": 0.5}
    )
    values = [run(one, supervise=False)["total.y"].values.tolist() for one in (read, compiled)]
    assert values[0] == values[1] == [1.5 * k for k in range(11)]
