"""FMI variables of a sensor on a plain connection."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from cosim.fmu.export import UNITS, ComponentSpec, Variable

MOST_VALUES = 64
"""Greatest number of values of one sensor."""
FAULTS = ("noise", "bias", "drift")
"""What changes during a run: inputs, so that events set them and signals drive them."""
_MOST_INTEGER = 2**31 - 1  # of FMI 2.0
_LARGEST = 1.7976931348623157e308
_FIXED = {
    "resolution": ("steps of {}; 0: none", 0.0),
    "least": ("least {} that it shows", -_LARGEST),
    "greatest": ("greatest {} that it shows", _LARGEST),
}


def plain_sensor_spec(
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
    """Specify a sensor.

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
    if not 1 <= len(values) <= MOST_VALUES:
        raise ValueError(f"{name}: a sensor has 1 to {MOST_VALUES} values, got {len(values)}")
    table: list[Variable] = []
    known = [(n, unit if unit in UNITS else None) for n, unit in values]
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
    apart = "between samples; 0 samples at every communication point"
    table += [
        Variable("sample_time", "parameter", apart, "s", sample_time, minimum=0.0),
        Variable("freeze.from", "parameter", "from then on it keeps its values", "s", freeze[0]),
        Variable("freeze.until", "parameter", "until then", "s", freeze[1]),
        Variable(
            "uniform",
            "parameter",
            "1: noise is half the width of a uniform one, 0: the deviation of a normal one",
            None,
            int(uniform),
            "Integer",
            minimum=0,
            maximum=1,
        ),
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
        description="Sensor on a plain connection: noise, bias, drift, steps, range, freezing",
        variables=tuple(table),
        behaviour="cosim.components.plain_sensor.behaviour:PlainSensor",
        sources=("cosim.network.single_draws", "cosim.components.plain_sensor.behaviour"),
        readme=Path(__file__).with_name("readme.md"),
        stop_time=60.0,
        step_size=step,
        constants={
            "sensor": name,
            "values": [n for n, _ in values],
            "named": ["frozen", "sample_time", "freeze.from", "freeze.until", "uniform", "seed"],
        },
    )
