"""FMI variables of a sensor; the default one fixes position and heading once a second."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cosim.fmu.export import UNITS, ComponentSpec, Variable

MOST_VALUES = 64
"""Greatest number of values of one sensor."""

_MOST_INTEGER = 2**31 - 1  # of FMI 2.0


def sensor_spec(
    name: str,
    values: Sequence[tuple[str, str | None]],
    *,
    noise: Sequence[float] = (),
    bias: Sequence[float] = (),
    sample_time: float = 1.0,
    offset: float = 0.0,
    seed: int = 1,
    step: float = 0.05,
    scenario: str = "",
) -> ComponentSpec:
    """Specify a sensor.

    Parameters
    ----------
    name : of the FMU; its random streams depend on it.
    values : what each value measures, for descriptions, and its unit (n,).
    noise, bias : standard deviation and constant error of each value (n,); none without them.
    sample_time, offset : between samples, and of the first one [s].
    seed : of the noise.
    step : of the default experiment [s].
    scenario : the page's example, as TOML.

    Raises
    ------
    ValueError : no value, more than `MOST_VALUES`, or noise or bias of another number.
    """
    count = len(values)
    if not 1 <= count <= MOST_VALUES:
        raise ValueError(f"{name}: a sensor has 1 to {MOST_VALUES} values, got {count}")
    for word, numbers in (("noise", noise), ("bias", bias)):
        if len(numbers) not in (0, count):
            raise ValueError(f"{name}: {word} has {len(numbers)} numbers for {count} values")
    inputs, outputs, deviations, errors = [], [], [], []
    for i, (text, given) in enumerate(values, 1):
        unit = given if given in UNITS else None
        inputs.append(Variable(f"u[{i}]", "input", f"{text}, as it is", unit))
        outputs.append(Variable(f"y[{i}]", "output", f"{text}, as measured", unit, discrete=True))
        words = f"standard deviation of y[{i}]", f"constant error of y[{i}]"
        start = float(noise[i - 1]) if noise else 0.0
        deviations.append(Variable(f"noise[{i}]", "parameter", words[0], unit, start, minimum=0.0))
        start = float(bias[i - 1]) if bias else 0.0
        errors.append(Variable(f"bias[{i}]", "parameter", words[1], unit, start))
    taken = "time at which the values were taken; before the first ones, 1 s before the run"
    apart = "between samples; 0 samples at every communication point"
    table = [
        *inputs,
        *outputs,
        Variable("stamp", "output", taken, "s", -1.0, discrete=True),
        Variable("sample_time", "parameter", apart, "s", sample_time, minimum=0.0),
        Variable("offset", "parameter", "of the first sample", "s", offset, minimum=0.0),
        *deviations,
        *errors,
        Variable(
            "seed",
            "parameter",
            "draws the noise",
            None,
            seed,
            "Integer",
            minimum=0,
            maximum=_MOST_INTEGER,
        ),
    ]
    return ComponentSpec(
        name=name,
        description="Sensor: sampled values with bias, noise and the time at which they were taken",
        variables=tuple(table),
        behaviour="cosim.components.sensor.behaviour:Sensor",
        sources=("cosim.network.single_draws", "cosim.components.sensor.behaviour"),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=60.0,
        step_size=step,
        scenario=scenario,
        constants={"sensor": name, "lanes": count},
    )


_SCENARIO = """\
title = "Position fixes with noise"

[run]
end = 20.0
step = 0.05

[components.plant]
fmu = "AuvPlant"
parameters = { "initial.nu.u" = 0.5 }

[components.fix]
fmu = "Sensor"
parameters = { "noise[1]" = 0.5, "noise[2]" = 0.5 }

[[connections]]
from = "plant.eta.x"
to = "fix.u[1]"

[[connections]]
from = "plant.eta.y"
to = "fix.u[2]"

[[connections]]
from = "plant.eta.z"
to = "fix.u[3]"

[[connections]]
from = "plant.eta.psi"
to = "fix.u[4]"
"""

SPEC = sensor_spec(
    "Sensor",
    [("position north", "m"), ("position east", "m"), ("depth", "m"), ("heading", "rad")],
    noise=(0.5, 0.5, 0.1, 0.02),
    scenario=_SCENARIO,
)
