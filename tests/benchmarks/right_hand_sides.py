"""Right-hand sides of the gallery's vehicles against their published models.

For random states, actuators and currents: the greatest relative difference of nu' and of eta'
(norm of the difference over the norm), and of an entry that is at least a thousandth of its vector.
The rates of the models are numbers that their own repositories computed, with errors of the
published form corrected and as published; tests/vehicle/published has them with their sources.

    python -m tests.benchmarks.right_hand_sides

Prints a table and JSON (--json: JSON alone, --page: docs/reference/vehicles.md).
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rich.table import Table

from cosim.vehicle import VEHICLES, Vehicle, load_vehicle
from tests.benchmarks._show import show

sys.path.insert(0, str(Path(__file__).parents[1] / "vehicle"))
from published_rates import NAMES, against_model, against_published, published

_HEAD = """\
# Vehicles of the gallery

These vehicle files come with the package, in `cosim/vehicle/gallery`; each names the sources of its
numbers. The vehicle of the paper is the NPS AUV II: the 22 derivatives of its Table 1, as corrected
here, equal those of Healey and Lienard (1993) in `npsauv.m` of MSS to the last digit, which
confirms every correction. Mass and density are the paper's (5454 kg, 1000 kg/m³) in `nps-auv2`,
which is the built-in `AuvPlant`, and those of `npsauv.m` (5443 kg, 1025 kg/m³) in `nps-auv2-6dof`.
"""
_COMPARED = """
Sensors, envelopes and controlled states are not part of the published models; their figures are
typical of such vehicles.

## Right-hand sides

The table has the greatest relative difference between the rates here and those of the model's own
repository, over random states, actuators and currents: for the vectors of accelerations ν′ and of
η′ (norm over norm), and for an entry that is at least a thousandth of its vector. "Corrected": with
the changes in the tables below; "as published": with a vehicle file that has the published errors,
in the cases where a file can express the model. This page is made by `python -m
tests.benchmarks.right_hand_sides --page`; the numbers and their sources are in
`tests/vehicle/published`, and `tests/vehicle/test_vehicle_gallery.py` holds them below
1e-9 (an entry of `nps-auv2-6dof` as published: 1e-8).
"""
_CONTRADICTIONS = """
The larger differences from `npsauv.m` as published come from `eps_prop`, its guard of a division.

MSS and PythonVehicleSimulator have further models of the same names. `remus100.m` of MSS (2025)
is a different vehicle from `remus100.py`: a spheroid scaled to 31.9 kg, cross-flow drag of a
cylinder in both planes, fins to 20 degrees; its surge damping fades with
`U_g=sqrt(nu(1)^1+nu(2)^2)`, a complex number at -1 m/s without sway, and its functions use 1026,
1025 (`crossFlowDrag.m`) and 1026 kg/m³ (`forceLiftDrag.m`) in one run. `remus100.py` says 31.9 kg
and computes with 31.03 kg."""
COLUMNS = ("vehicle", "against", "cases", "of ν′", "of η′", "of an entry")


def figures() -> Iterator[dict[str, Any]]:
    """Compare every vehicle with its model, corrected and as published."""
    for name in NAMES:
        for against, found in (
            ("the model, corrected", against_model(name)),
            ("the model as published", against_published(name)),
        ):
            yield {"vehicle": name, "against": against, **found._asdict()}


def cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a row."""
    numbers = [f"{row[key]:.1e}" for key in ("speed", "position", "entry")]
    return [row["vehicle"], row["against"], str(row["cases"]), *numbers]


def page() -> Iterator[str]:
    """Yield the lines of docs/reference/vehicles.md."""
    yield _HEAD
    yield "| vehicle | what it is | trim | actuators | sensors |"
    yield "|---|---|---|---|---|"
    for name in VEHICLES:
        yield _line(load_vehicle(name))
    yield _COMPARED
    yield f"| {' | '.join(COLUMNS)} |"
    yield f"|{'---|' * len(COLUMNS)}"
    for row in figures():
        first, *rest = cells(row)
        yield f"| {' | '.join([f'`{first}`', *rest])} |"
    yield _CONTRADICTIONS
    for name in NAMES:
        known = published(name)
        source = known["source"]
        yield f"\n## What differs from the published {name}\n"
        yield _filled(f"{source['model']}.")
        files = ", ".join(f"`{file}`" for file in source["files"])
        numbers = f"Numbers: {source['repository']}, commit {source['commit'][:12]}, {files}"
        if "second_repository" in source:
            also = ", ".join(source["second_files"])
            commit = source["second_commit"][:12]
            numbers += f"; {source['second_repository']}, commit {commit}, {also}"
        yield _filled(f"{numbers}. {source['how']}.")
        yield "\n| published | modelled | why |\n|---|---|---|"
        for change in known["changed"]:
            row_ = [f"`{change['published']}`", f"`{change['modelled']}`", change["why"]]
            yield f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row_)} |"


def _line(vehicle: Vehicle) -> str:
    """Return the row of a vehicle."""
    speed = vehicle.trim.get("nu.u", 0.0)
    over = {"link": ", over the link", "onboard": ""}
    sensors = (f"{s.name} ({s.interval:g} s{over[s.over]})" for s in vehicle.sensors)
    row = (
        f"`{vehicle.name}`",
        vehicle.description,
        f"{speed:g} m/s" if speed else "hover",
        ", ".join(a.name for a in vehicle.actuators),
        ", ".join(sensors),
    )
    return f"| {' | '.join(row)} |"


def _filled(text: str) -> str:
    return textwrap.fill(text, 110, break_long_words=False, break_on_hyphens=False)


def main() -> None:
    """Print the table."""
    if "--page" in sys.argv:
        print("\n".join(page()))
        return
    rows = [*figures()]
    table = Table(*COLUMNS, title="Greatest relative differences")
    for row in rows:
        table.add_row(*cells(row))
    show(table, rows)


if __name__ == "__main__":
    main()
