"""How a run ends, in words."""

from __future__ import annotations

from cosim.core import ComponentError
from cosim.master.engine import Halt
from cosim.master.exchange import TOO_LARGE
from cosim.master.run import Ending
from cosim.master.system import System
from cosim.master.wiring import Wiring

_DISCARD = 2


def ending_of(system: System, wiring: Wiring, halt: Halt) -> tuple[Ending, str]:
    """What ended a run; a state beyond the range of numbers is no defect."""
    seconds = int(wiring.course.points_ns[halt.k]) / 1e9
    if halt.what == "range":
        out = f"{wiring.output(halt.station)} left the range of +-{system.divergence:g}"
        return "diverged", f"{out} at t = {seconds:g} s"
    station = wiring.stations[halt.station]
    discarded = halt.what == "step" and halt.status == _DISCARD  # how a slave of FMI 2 asks
    if halt.what == "end" or (discarded and station.slave.asked_to_end()):
        said = f"component {station.name!r} asked for the end in the step from t = {seconds:g} s"
        return "stopped", said
    slave = station.slave
    if halt.status == TOO_LARGE:
        error = ComponentError(
            f"an integer read at t = {seconds:g} s is too large to be exchanged",
            where=f"component {station.name!r} ({slave.description.path.name})",
            expected="a magnitude of at most 2**53",
        )
        return "failed", error.text()
    at = "from" if halt.what == "step" else "at"
    refused = slave.refused(f"{halt.what} {at} t = {seconds:g} s", halt.status)
    overflow = "no longer finite" in (refused.got or "")
    return ("diverged" if overflow else "failed"), refused.text()
