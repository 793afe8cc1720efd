"""The designs of auv-survey, auv-survey-naive and auv-remote, made again from the vehicle's file.

All are for the vehicle nps-auv2 of the gallery, with the noise of its sensors and its weights; they
differ in the ages that measurements and commands may have. What flies are the stored files,
whatever a solver says here: a new gamma differs from the stored one in its last digits, by machine
and solver.

    python -m tests.benchmarks.vehicle_designs [NAME ...]

Prints a table and JSON (--json: JSON alone, --write: stores what was made). Some four CPU minutes.
With --keep the stored K and L are proved again, at the order of the stored proof, for the ages
below; nothing is searched. Six CPU minutes.
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
from cosim.models import Measurement
from cosim.vehicle import estimated_states, known_delays, linear_model, load_vehicle, plant_note
from tests.benchmarks._show import show

DESIGNS = Path(str(files("cosim.scenario").joinpath("library", "designs")))
BOARD = ("nu.u", "nu.v", "nu.w", "nu.r", "eta.psi", "eta.z")
FIX = ("eta.x", "eta.y")
MEASURED = {
    "auv-survey": {"onboard": (BOARD, 0.3), "usbl": (FIX, 13.1)},
    "auv-survey-naive": {"onboard": (BOARD, 0.3), "usbl": (FIX, 0.3)},
    "auv-remote": {"telemetry": (BOARD, 1.5), "usbl": (FIX, 3.1)},
}
"""By design and measurement what is measured, and its greatest age [s]."""
COMMAND_AGE = {"auv-survey": 0.1, "auv-survey-naive": 0.1, "auv-remote": 1.2}
"""Greatest age of commands [s], any age up to it.

On board: held for a step of 0.05 s, and a step more for the coupling. From the ship: play-out,
hold, step and a margin.
"""


def question(name: str) -> tuple[Any, Any, dict[str, Any]]:
    """System, measurements and note of a design."""
    model = linear_model(load_vehicle("nps-auv2"))
    noise: dict[str, float] = {}
    for sensor in model.vehicle.sensors:
        noise |= dict(zip(sensor.measures, sensor.noise, strict=True))
    measured = []
    for each, (states, age) in MEASURED[name].items():
        rows = [[float(state == one) for state in model.states] for one in states]
        over = "onboard" if each == "onboard" else "link"
        own = [noise[state] for state in states]
        measured.append(Measurement(each, rows, age, any_age=True, noise=own, over=over))
    return known_delays(model.system), tuple(measured), plant_note(model).to_json()


def designed(name: str, kept: dict[str, Any] | None = None) -> dict[str, Any]:
    """The file of a design, made now; of the K and L of a stored one where that is given."""
    system, measured, note = question(name)
    gains: dict[str, Any] = {}
    if kept is not None:
        pair = hinf.certificate.pair_from_json(kept)
        # the noise that is proved has been rounded up for this L
        measured = pair.measurements
        gains = {"gain": pair.K, "injections": pair.L, "order": kept["pair"]["variables"]["order"]}
    found = hinf.design_output_feedback(
        *(system, measured),
        estimated=estimated_states(system),
        command_age=COMMAND_AGE[name],
        command_any_age=True,
        **gains,
    )
    noted = replace(found, certificate={**found.certificate, PLANT_NOTE: note})
    return DESIGN_FILE.stamped(noted.to_json())


def main() -> None:
    """Make them, and show them beside the stored ones."""
    rows = []
    chosen = [name for name in MEASURED if name in sys.argv] or [*MEASURED]
    for name in chosen:
        began, path = time.process_time(), DESIGNS / f"{name}.json"
        kept = json.loads(path.read_bytes())
        made = designed(name, kept if "--keep" in sys.argv else None)
        gammas = [hinf.Result.from_json(data, where=name).gamma for data in (kept, made)]
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
