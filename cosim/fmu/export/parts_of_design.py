"""The FMUs that follow from the design of an observed vehicle: plant, sensors, controller.

The design file keeps, beside its proof, how the plant is seen as the linear system, and what the
FMU of the plant is made from: the note `plant_note`.
"""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from cosim.core import PLANT_NOTE, InputError, cache_folder
from cosim.fmu.export.build import Built, build_fmu, guid_of, inside_fmu
from cosim.fmu.export.components import component_module
from cosim.fmu.export.identity import kept_guid
from cosim.fmu.export.spec import ComponentSpec
from cosim.hinf.certificate import certificate_bytes

PLANT, CONTROLLER = "plant", "controller"

_OBSERVER = component_module("observer.variables")
_SENSOR = component_module("sensor.variables")
_VEHICLE = component_module("vehicle_plant.variables")


def design_parts(data: Any) -> list[str]:
    """Return the parts of a design of which there is an FMU: plant, controller, measurements.

    Empty for a design that does not say what its plant is made from.
    """
    note = data.get(PLANT_NOTE) if isinstance(data, dict) else None
    if not (isinstance(note, dict) and note.get("model") and data.get("measurements")):
        return []
    return [PLANT, CONTROLLER, *(one["name"] for one in data["measurements"])]


def design_part_spec(data: Any, part: str, *, name: str, where: str | None = None) -> ComponentSpec:
    """Specify the FMU of a part of a design.

    Parameters
    ----------
    data : the design, as JSON values.
    part : "plant", "controller", or the name of a measurement, whose sensor it is.
    name : of the model.
    where : the design, for messages.

    Raises
    ------
    InputError : no such part, or a design of which there are none.
    """
    parts = design_parts(data)
    if not parts:
        raise InputError(
            "no FMU follows from this design",
            where=where,
            expected="the design of a vehicle with an observer, as cosim vehicle fly keeps it",
            got=f"a design of kind {data.get('kind') if isinstance(data, dict) else data!r}",
        )
    if part not in parts:
        raise InputError.unknown("part of the design", part, parts, where=where)
    note = data[PLANT_NOTE]
    spec: ComponentSpec
    if part == PLANT:
        spec = _VEHICLE.vehicle_plant_spec(_VEHICLE.record_from_json(note["model"]), name=name)
    elif part == CONTROLLER:
        own = vehicle_settings(data)
        spec = _OBSERVER.output_feedback_spec(name, certificate_bytes(data), **own)
    else:
        one = next(m for m in data["measurements"] if m["name"] == part)
        measured = [(text, _VEHICLE.unit_of_state(text)) for text in _measured(one, note)]
        spec = _SENSOR.sensor_spec(name, measured, noise=one["noise"])
    return spec


def vehicle_settings(data: Any) -> dict[str, Any]:
    """Return what a design says of its vehicle, as arguments of `output_feedback_spec`.

    Commands of its actuators with their limits, the thrust map, the trim, the envelope, and units;
    nothing for a design of no vehicle.
    """
    if not design_parts(data):
        return {}
    note = data[PLANT_NOTE]
    record, states = _VEHICLE.record_from_json(note["model"]), _states(note)
    at_trim, scales = note["control"]["trim"], _scales(note)
    return {
        "limits": [a.limit for a in record.actuators],
        "safe": at_trim,
        "envelope": {
            i: note["envelope"][state][1] * scales[i]
            for i, state in enumerate(states, 1)
            if state in note["envelope"]
        },
        "units": [_VEHICLE.unit_of_state(state) for state in states],
        "outputs": [(a.command, a.unit) for a in record.actuators],
        "thrust_map": note["thrust_map"],
        "allocation": note["control"]["map"],
        "trim": at_trim,
        "trim_measured": {
            one["name"]: [note["trim"][state] for state in _measured(one, note)]
            for one in data["measurements"]
        },
    }


def _states(note: Any) -> list[str]:
    """Return the output of the plant that each state of the design is; "" for a mixture."""
    names, rows = note["state"]["names"], note["state"].get("map")
    if rows is None:
        return list(names)
    used = [[j for j, entry in enumerate(row) if entry] for row in rows]
    return [names[places[0]] if len(places) == 1 else "" for places in used]


def _scales(note: Any) -> dict[int, float]:
    """Return by the number of a state from 1 what a unit of the plant's output counts in it."""
    rows = note["state"].get("map") or []
    return dict.fromkeys(range(1, 1 + len(note["state"]["names"])), 1.0) | {
        i: max(map(abs, row)) for i, row in enumerate(rows, 1)
    }


def _measured(one: Any, note: Any) -> list[str]:
    """Return the outputs of the plant that a measurement consists of."""
    found = []
    for row in one["C"]:
        used = [j for j, entry in enumerate(row) if entry]
        if len(used) != 1 or not (state := _states(note)[used[0]]):
            raise InputError(
                "a sensor measures outputs of the plant one by one",
                where=f"measurement {one['name']}",
                expected="rows of C with a single entry",
                got=f"{len(used)} entries",
            )
        found.append(state)
    return found


def ensure_design_fmu(
    content: bytes, design: str, part: str, root: Path, *, flavour: str, where: str
) -> Built:
    """Return the FMU of a part of a design; build it below `root`/`flavour` if there is none.

    Parameters
    ----------
    content : the file of the design, whose `design` is the name.
    where : the design, for messages.

    Raises
    ------
    InputError : see `design_part_spec`; no compiler for a native FMU that has to be built.
    """
    data = json.loads(content)
    model = re.sub(r"\W", "_", f"{design}_{part}", flags=re.ASCII)
    path = root / flavour / f"{model}.fmu"
    key = f"{flavour}/{model}/{hashlib.sha256(content).hexdigest()}"

    def spec() -> ComponentSpec:
        return design_part_spec(data, part, name=model, where=where)

    if path.is_file():
        now = kept_guid(key, cache_folder(), lambda: guid_of(spec(), flavour))
        if inside_fmu(path)[0] == now:
            return Built(model, path, new=False)
    build_fmu(spec(), path.parent, flavour)
    return Built(model, path, new=True)
