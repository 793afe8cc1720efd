"""The designs of auv-survey and auv-survey-naive, made again from the vehicle's file.

Both are for the vehicle nps-auv2 of the gallery with its sensors and weights, with fixes every two
seconds; they differ in the age that a fix may have. What flies are the stored files, whatever a
solver says here: a new gamma differs from the stored one in its last digits, by machine and solver.

    python -m tests.benchmarks.survey_designs

Prints a table and JSON (--json: JSON alone, --write: stores what was made).
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from rich.table import Table

from cosim import hinf
from cosim.core import DESIGN_FILE, PLANT_NOTE
from cosim.vehicle import FlightSettings, linear_model, load_vehicle
from cosim.vehicle.flight import estimated_states, known_delays, measurements_of, plant_note
from cosim.vehicle.flight_plan import planned_sensors
from tests.benchmarks._show import show

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))
AGES = {"auv-survey": 13.1, "auv-survey-naive": 0.3}
"""Greatest age of a fix [s]: 3 s under way, 2 s apart, four in a row lost, and two steps."""
_INTERVAL = 2.0


def question(age: float) -> tuple[Any, Any, dict[str, Any]]:
    """System, measurements and note of a design for fixes of an age."""
    model = linear_model(load_vehicle("nps-auv2"))
    sensors = planned_sensors(model.vehicle.sensors, model.states, FlightSettings())
    sensors = tuple(replace(s, age=age, interval=_INTERVAL) if s.loss else s for s in sensors)
    return known_delays(model.system), measurements_of(model, sensors), plant_note(model).to_json()


def designed(age: float) -> dict[str, Any]:
    """The file of a design, made now."""
    system, measured, note = question(age)
    found = hinf.design_output_feedback(system, measured, estimated=estimated_states(system))
    noted = replace(found, certificate={**found.certificate, PLANT_NOTE: note})
    return DESIGN_FILE.stamped(noted.to_json())


def main() -> None:
    """Make both, and show them beside the stored ones."""
    rows = []
    for name, age in AGES.items():
        began = time.process_time()
        made, path = designed(age), DESIGNS / f"{name}.json"
        kept = json.loads(path.read_bytes())
        gammas = [hinf.design_from_json(data, where=name).gamma for data in (kept, made)]
        seconds = time.process_time() - began
        rows.append({"design": name, "stored": gammas[0], "made": gammas[1], "cpu_s": seconds})
        if "--write" in sys.argv:
            path.write_text(json.dumps(made, indent=1, allow_nan=False) + "\n", "utf-8")
    table = Table("design", "gamma, stored", "gamma, made now", "CPU s")
    for row in rows:
        numbers = (f"{row['stored']:.5g}", f"{row['made']:.5g}", f"{row['cpu_s']:.0f}")
        table.add_row(row["design"], *numbers)
    show(table, rows)


if __name__ == "__main__":
    main()
