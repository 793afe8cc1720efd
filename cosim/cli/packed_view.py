"""FMUs of controllers and plants that were exported, formatted for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.terminal import facts_table
from cosim.core import at_most

if TYPE_CHECKING:  # `cosim fmu check` needs neither
    from cosim.fmu import ControllerFmu, PlantFmu
    from cosim.vehicle import VehicleFmu


def packed_view(packed: ControllerFmu) -> RenderableType:
    """Show a controller FMU that was exported, and what its certificate proves."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    facts = facts_table()
    how = {
        "vehicle": "eta, nu to thrust",
        "system": "x[j] to u[i]",
        "output-feedback": "stamped measurements to u[i]",
        "observer": "stamped measurements and u[i] to the estimate",
    }[packed.form]
    facts.add_row("model", packed.name, Text(f"{packed.kind.text}; {how}"))
    facts.add_row("K", f"{len(packed.K)} x {len(packed.K[0])}", Text("start values of K[i,j]"))
    gamma = packed.claim["gamma"]
    if gamma is not None:
        facts.add_row("gamma", at_most(gamma), "certified, for this K")
    facts.add_row("certificate", packed.sha256[:16], "SHA-256; resources/certificate.json")
    return Group(head, facts)


def vehicle_plant_view(made: VehicleFmu) -> RenderableType:
    """Show the plant FMU of a vehicle that was exported."""
    head = Text.assemble(("packed", "bold green"), f": {made.path}")
    vehicle = made.vehicle
    facts = facts_table()
    facts.add_row("model", made.name, made.kind.text)
    facts.add_row("vehicle", vehicle.name, f"{vehicle.degrees_of_freedom} degrees of freedom")
    commands = [a.command for a in vehicle.actuators]
    facts.add_row("commands", str(len(commands)), ", ".join(commands))
    facts.add_row("states", str(len(vehicle.states)), ", ".join(vehicle.states))
    facts.add_row("parameters", str(len(vehicle.parameters)), "every number of the file")
    facts.add_row("solver.step", f"{made.step:g} s", "largest internal step")
    return Group(head, facts)


def plant_view(packed: PlantFmu) -> RenderableType:
    """Show a plant FMU that was exported: its sizes, and where the delays of its system are."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    facts = facts_table()
    facts.add_row("model", packed.name, packed.kind.text)
    facts.add_row("inputs", f"{m} u, {q} w", "")
    facts.add_row("outputs", f"{n} x, {p} z", "")
    for name, d in packed.delays.items():
        facts.add_row(name, f"{d:g} s", "a parameter, like every matrix entry")
    if not packed.system.immediate_feedback:
        late = f"{packed.system.feedback_delay:g} s"
        facts.add_row(
            "feedback", late, "delay of the link between plant and controller, not in the FMU"
        )
    facts.add_row("solver.step", f"{packed.step:g} s", "largest internal step")
    return Group(head, facts)
