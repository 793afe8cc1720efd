"""A component that no catalogue has: two delays, one of which may be zero, nonlinear."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim.fmu.export import ComponentSpec, DelayPlant, Variable
from cosim.models import auv


class TwoDelays(DelayPlant):
    """The equation of tests/models/test_delay_line.py."""

    inputs = ("push[1]", "push[2]")
    states = ("x[1]", "x[2]")
    delays = ("delay.first", "delay.second")

    def __init__(self, constants: dict[str, Any]) -> None:
        del constants

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Keep a remark that C must write with care."""
        return [(v["gain"] * v["gain"] - 0.0625, 'a "gain" of % must exceed 1/4 */ ä')]

    def constants(self, v: Any) -> Any:
        """Nothing but a product of parameters."""
        return v["gain"] / 2.0

    def rates(self, t: Any, x: Any, late: Any, u: Any, c: Any, ns: Any) -> list[Any]:
        """Couple both states with every delay in both."""
        del t
        first = -0.4 * x[0] + 0.3 * ns.sin(x[1]) + u[0] * c
        second = 0.5 * ns.cos(x[0]) - 0.2 * x[1] + u[1] * c
        for k, past in enumerate(late):
            first -= (1.1 - 0.3 * k) * past[0] * (1 + 0.1 * past[1])
            second += (0.3 + 0.2 * k) * past[0] - 0.7 * past[1]
        return [first, second]

    def outputs(self, x: Any, u: Any, c: Any) -> dict[str, Any]:
        """Multiply a state by an input, for the derivative."""
        return {"power": x[0] * u[0] * c - (u[1] - u[0]) * u[0]}


SPEC = ComponentSpec(
    name="TwoDelays",
    description="Two delays */ and a comment's end",
    variables=(
        Variable("push[1]", "input", "push"),
        Variable("push[2]", "input", "push"),
        Variable("x[1]", "output", "state", start=1.0),
        Variable("x[2]", "output", "state", start=-0.5),
        Variable("power", "output", "power", depends_on=("push[1]", "push[2]")),
        Variable("gain", "parameter", "gain", start=2.0),
        Variable("delay.first", "parameter", "delay", "s", 0.3, minimum=0.0),
        Variable("delay.second", "parameter", "delay", "s", 0.47, minimum=0.0),
        Variable("initial.x[1]", "parameter", "start", start=1.0),
        Variable("initial.x[2]", "parameter", "start", start=-0.5),
        Variable("solver.step", "parameter", "step", "s", 0.1, minimum=1e-6),
    ),
    behaviour=f"{__name__}:TwoDelays",
    sources=(),
    readme=Path(auv.__file__).parents[2] / "fmu_src" / "auv_plant" / "readme.md",
    stop_time=1.0,
    step_size=0.1,
)


class NoDelay(DelayPlant):
    """A component with nothing that C could count: no inputs, no delays, no other outputs."""

    inputs = ()
    states = ("x",)
    delays = ()

    def __init__(self, constants: dict[str, Any]) -> None:
        del constants

    def constants(self, v: Any) -> None:
        """Nothing."""

    def rates(self, t: Any, x: Any, late: Any, u: Any, c: Any, ns: Any) -> list[Any]:
        """Follow the time."""
        del late, u, c
        return [ns.cos(t) - x[0]]


NO_DELAY = ComponentSpec(
    name="NoDelay",
    description="x' = cos t - x",
    variables=(
        Variable("x", "output", "state", start=0.5),
        Variable("initial.x", "parameter", "start", start=0.5),
        Variable("solver.step", "parameter", "step", "s", 0.1, minimum=1e-6),
    ),
    behaviour=f"{__name__}:NoDelay",
    sources=(),
    readme=SPEC.readme,
    stop_time=1.0,
    step_size=0.1,
)
