"""The documentation page of an observer: its dimensions, and a run with plant and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cosim.fmu.export import round_below

_MOST_VALUES = 4  # of the built-in Sensor


def notes(data: Mapping[str, Any], ages: Mapping[str, float], constants: Mapping[str, Any]) -> str:
    """Return what is particular of an FMU as Markdown.

    Parameters
    ----------
    data : its certificate.
    ages : greatest age per measurement [s].
    constants : those of its behaviour.
    """
    n, m = len(data["plant"]["A"]), len(data["plant"]["B"][0])
    commands = constants["commands"]
    own = f"{n} state{_s(n)}, {m} control{_s(m)}"
    if commands:
        bounds = "limited to ± `limit.`" if constants["with_limits"] else "without limits"
        own += f", {len(commands)} command{_s(len(commands))}, {bounds}"
    else:
        own += "; the control that acts is an input"
    lines = ["", "## This one", "", f"{own}.", "", "| measurement | values | greatest age |"]
    lines += ["|---|---|---|"]
    for one in data["measurements"]:
        name = one["name"]
        lines.append(f"| `{name}` | {len(one['C'])} | {ages[name]:g} s |")
    return "\n".join([*lines, ""])


def scenario_of(data: Mapping[str, Any], controller: str) -> str:
    """Return the TOML of a run with the plant and a sensor per measurement; "" if none fits.

    Measurements over the link go through a packet link, the others are taken at every step. Half of
    each greatest age is left to the exchange.
    """
    rows = {one["name"]: one["C"] for one in data["measurements"]}
    ages = {one["name"]: float(one["d"]) for one in data["measurements"]}
    plain = all(
        sorted(map(abs, row)) == [*[0.0] * (len(row) - 1), 1.0] and max(row) == 1.0
        for C in rows.values()
        for row in C
    )
    if not plain or min(ages.values()) <= 0 or max(map(len, rows.values())) > _MOST_VALUES:
        return ""
    step = round_below(min(0.05, min(ages.values()) / 4))
    joined, sensors, links = [], "", ""
    for one in data["measurements"]:
        name, apart = one["name"], round_below(ages[one["name"]] / 4)
        linked = one.get("over", "link") == "link"
        way = f" : {name}_link" if linked else ""
        values = range(1, len(rows[name]) + 1)
        joined += [f"plant.x[{rows[name][i - 1].index(1.0) + 1}] -> {name}.u[{i}]" for i in values]
        joined += [f"{name}.y[{i}] -> controller.{name}[{i}]{way}" for i in values]
        joined.append(f"{name}.stamp -> controller.stamp.{name}{way}")
        quiet = "".join(f', "noise[{i}]" = 0.0' for i in values)
        period = apart if linked else 0
        sensors += f"""
[components.{name}]
fmu = "Sensor"
parameters = {{ sample_time = {period:g}{quiet} }}
"""
        if linked:
            links += f"""
[links.{name}_link]  # up to {ages[name]:g} s old is allowed, hold and exchange included
kind = "packet"
sample_time = {apart:g}
offset = {step:g}
delay = {apart:g}
"""
    joined.append("controller.u -> plant.u")
    listed = "\n".join(f'    "{text}",' for text in joined)
    return f"""\
title = "Plant, sensors, and a controller with an observer"
connect = [
{listed}
]

[run]
end = 20.0
step = {step:g}

[components.plant]
fmu = "plant.fmu"  # cosim fmu build my-system.toml -o plant.fmu
parameters = {{ "initial.x[1]" = 1.0 }}

[components.controller]
fmu = "{controller}"
{sensors}{links}"""


def _s(count: int) -> str:
    return "" if count == 1 else "s"
