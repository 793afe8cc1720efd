"""FMI variables of a sensor; the default one fixes position and heading once a second."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cosim.fmu.export import UNITS, ComponentSpec, Variable

MOST_VALUES = 64
"""Greatest number of values of one sensor."""
FAULTS = ("noise", "bias", "drift")
"""What changes during a run, without a stamp: inputs, which events set and signals drive."""

_BEHAVIOUR = "cosim.components.sensor.behaviour:Sensor"
_SOURCES = ("cosim.network.single_draws", "cosim.components.sensor.behaviour")
_README = Path(__file__).with_name("readme.md")
_MOST_INTEGER = 2**31 - 1  # of FMI 2.0
_LARGEST = 1.7976931348623157e308
_FIXED = {
    "resolution": ("steps of {}; 0: none", 0.0),
    "least": ("least {} that it shows", -_LARGEST),
    "greatest": ("greatest {} that it shows", _LARGEST),
}


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
    """Specify a sensor with a stamp: inputs u[1], u[2], ..., outputs y[1], y[2], ...

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
    known = _known(name, values)
    for word, numbers in (("noise", noise), ("bias", bias)):
        if len(numbers) not in (0, len(known)):
            raise ValueError(f"{name}: {word} has {len(numbers)} numbers for {len(known)} values")
    inputs, outputs, deviations, errors = [], [], [], []
    for i, (text, unit) in enumerate(known, 1):
        inputs.append(Variable(f"u[{i}]", "input", f"{text}, as it is", unit))
        outputs.append(Variable(f"y[{i}]", "output", f"{text}, as measured", unit, discrete=True))
        words = f"standard deviation of y[{i}]", f"constant error of y[{i}]"
        start = float(noise[i - 1]) if noise else 0.0
        deviations.append(Variable(f"noise[{i}]", "parameter", words[0], unit, start, minimum=0.0))
        start = float(bias[i - 1]) if bias else 0.0
        errors.append(Variable(f"bias[{i}]", "parameter", words[1], unit, start))
    taken = "time at which the values were taken; before the first ones, 1 s before the run"
    return ComponentSpec(
        name=name,
        description="Sensor: sampled values with bias, noise and the time at which they were taken",
        variables=(
            *inputs,
            *outputs,
            Variable("stamp", "output", taken, "s", -1.0, discrete=True),
            _apart(sample_time),
            Variable("offset", "parameter", "of the first sample", "s", offset, minimum=0.0),
            *deviations,
            *errors,
            _seed(seed),
        ),
        scenario=scenario,
        constants={
            "sensor": name,
            "stamped": True,
            "lanes": {
                role: [v.name for v in listed]
                for role, listed in (
                    ("input", inputs),
                    ("output", outputs),
                    ("bias", errors),
                    ("noise", deviations),
                )
            },
        },
        behaviour=_BEHAVIOUR,
        sources=_SOURCES,
        readme=_README,
        stop_time=60.0,
        step_size=step,
    )


def sensor_at_once_spec(
    name: str,
    values: Sequence[tuple[str, str | None]],
    settings: Mapping[str, float],
    *,
    uniform: bool = False,
    sample_time: float = 0.0,
    seed: int = 1,
    freeze: tuple[float, float] = (0.0, 0.0),
    step: float = 0.05,
) -> ComponentSpec:
    """Specify a sensor on a plain connection: inputs true.NAME, outputs NAME.

    Parameters
    ----------
    name : of the FMU; its random streams depend on it.
    values : what it measures, and the unit.
    settings : noise, bias, drift [per s], resolution, least and greatest, the same for all values.
    uniform : noise is the half-width of a uniform one, not the deviation of a normal one.
    sample_time : between samples [s]; 0: one at every communication point.
    freeze : first and last instant of a time in which it keeps its value [s].
    step : of the default experiment [s].

    Raises
    ------
    ValueError : no value, or more than `MOST_VALUES`.
    """
    known = _known(name, values)
    table: list[Variable] = []
    drifts = {unit: f"{unit}/s" if f"{unit}/s" in UNITS else None for _, unit in known}
    drifts |= {"m/s": "m/s2", "rad/s": "rad/s2"}
    words = {
        "noise": "size of the noise of {}, which 0 or less has not",
        "bias": "error of {}",
        "drift": "its growth per s",
    }
    table += [Variable(f"true.{n}", "input", f"{n}, as it is", unit) for n, unit in known]
    for fault in FAULTS:
        for n, unit in known:
            own = drifts[unit] if fault == "drift" else unit
            text, start = words[fault].format(n), settings.get(fault, 0.0)
            table.append(Variable(f"{fault}.{n}", "input", text, own, start))
    table.append(Variable("frozen", "input", "1: it keeps its values", None, 0.0))
    for n, unit in known:
        reads = (f"true.{n}", *(f"{fault}.{n}" for fault in FAULTS), "frozen")
        table.append(Variable(n, "output", f"{n}, as measured", unit, depends_on=reads))
    for key, (text, default) in _FIXED.items():
        for n, unit in known:
            start = settings.get(key, default)
            table.append(Variable(f"{key}.{n}", "parameter", text.format(n), unit, start))
    uniform_text = "1: noise is half the width of a uniform one, 0: the deviation of a normal one"
    table += [
        _apart(sample_time),
        Variable("freeze.from", "parameter", "from then on it keeps its values", "s", freeze[0]),
        Variable("freeze.until", "parameter", "until then", "s", freeze[1]),
        Variable(
            *("uniform", "parameter", uniform_text, None, int(uniform), "Integer"),
            minimum=0,
            maximum=1,
        ),
        _seed(seed),
    ]
    prefixes = {"input": "true.", "output": ""} | {one: f"{one}." for one in (*FAULTS, *_FIXED)}
    lanes = {role: [f"{prefix}{n}" for n, _ in values] for role, prefix in prefixes.items()}
    return ComponentSpec(
        name=name,
        description="Sensor on a plain connection: noise, bias, drift, steps, range, freezing",
        variables=tuple(table),
        constants={
            "sensor": name,
            "stamped": False,
            "lanes": lanes,
        },
        behaviour=_BEHAVIOUR,
        sources=_SOURCES,
        readme=_README,
        stop_time=60.0,
        step_size=step,
    )


def _known(name: str, values: Sequence[tuple[str, str | None]]) -> list[tuple[str, str | None]]:
    """Return the values with the units that an FMU can declare."""
    if not 1 <= len(values) <= MOST_VALUES:
        raise ValueError(f"{name}: a sensor has 1 to {MOST_VALUES} values, got {len(values)}")
    return [(text, unit if unit in UNITS else None) for text, unit in values]


def _apart(sample_time: float) -> Variable:
    text = "between samples; 0 samples at every communication point"
    return Variable("sample_time", "parameter", text, "s", sample_time, minimum=0.0)


def _seed(seed: int) -> Variable:
    return Variable(
        *("seed", "parameter", "draws the noise", None, seed, "Integer"),
        minimum=0,
        maximum=_MOST_INTEGER,
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
