"""FMUs of controllers and plants that were exported, formatted for a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import RenderableType

from cosim.cli.terminal import facts
from cosim.core import at_most

if TYPE_CHECKING:  # `cosim fmu check` needs neither
    from cosim.fmu.export import ControllerFmu, PlantFmu
    from cosim.vehicle import VehicleFmu


def packed_view(packed: ControllerFmu) -> RenderableType:
    """Show a controller FMU that was exported, and what its certificate proves."""
    how = {
        "vehicle": "eta, nu to thrust",
        "system": "x[j] to u[i]",
        "output-feedback": "stamped measurements to u[i]",
        "observer": "stamped measurements and u[i] to the estimate",
    }[packed.form]
    gamma = packed.claim["gamma"]
    bound = [] if gamma is None else [("gamma", at_most(gamma), "certified, for this K")]
    return facts(
        ("model", packed.name, f"{packed.kind.text}; {how}"),
        ("K", f"{len(packed.K)} x {len(packed.K[0])}", "start values of K[i,j]"),
        *bound,
        ("certificate", packed.sha256[:16], "SHA-256; resources/certificate.json"),
    )


def vehicle_plant_view(made: VehicleFmu) -> RenderableType:
    """Show the plant FMU of a vehicle that was exported."""
    vehicle = made.vehicle
    commands = [a.command for a in vehicle.actuators]
    return facts(
        ("model", made.name, made.kind.text),
        ("vehicle", vehicle.name, f"{vehicle.degrees_of_freedom} degrees of freedom"),
        ("commands", str(len(commands)), ", ".join(commands)),
        ("states", str(len(vehicle.states)), ", ".join(vehicle.states)),
        ("parameters", str(len(vehicle.parameters)), "every number of the file"),
        ("solver.step", f"{made.step:g} s", "largest internal step"),
    )


def plant_view(packed: PlantFmu) -> RenderableType:
    """Show a plant FMU that was exported: its sizes, and where the delays of its system are."""
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    late = f"{packed.system.feedback_delay:g} s"
    link = ("feedback", late, "delay of the link between plant and controller, not in the FMU")
    parameter = "a parameter, like every matrix entry"
    return facts(
        ("model", packed.name, packed.kind.text),
        ("inputs", f"{m} u, {q} w"),
        ("outputs", f"{n} x, {p} z"),
        *((name, f"{d:g} s", parameter) for name, d in packed.delays.items()),
        *[link] * (not packed.system.immediate_feedback),
        ("solver.step", f"{packed.step:g} s", "largest internal step"),
    )
