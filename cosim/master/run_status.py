"""How a run ends, in words."""

from __future__ import annotations

from cosim.core import ComponentError
from cosim.master.engine import EarlyStop
from cosim.master.exchange import TOO_LARGE
from cosim.master.run import RunStatus
from cosim.master.system import System
from cosim.master.wiring import Wiring

_DISCARD = 2


def run_status_of(system: System, wiring: Wiring, early_stop: EarlyStop) -> tuple[RunStatus, str]:
    """What ended a run; a state beyond the range of numbers is no defect."""
    seconds = int(wiring.comm_points.points_ns[early_stop.k]) / 1e9
    if early_stop.what == "range":
        out = f"{wiring.output(early_stop.instance)} left the range of +-{system.divergence:g}"
        return "diverged", f"{out} at t = {seconds:g} s"
    instance = wiring.instances[early_stop.instance]
    discarded = (
        early_stop.what == "step" and early_stop.status == _DISCARD
    )  # how a slave of FMI 2 asks
    if early_stop.what == "end" or (discarded and instance.slave.asked_to_end()):
        reason = f"component {instance.name!r} asked for the end in the step from t = {seconds:g} s"
        return "stopped", reason
    slave = instance.slave
    if early_stop.status == TOO_LARGE:
        error = ComponentError(
            f"an integer read at t = {seconds:g} s is too large to be exchanged",
            where=f"component {instance.name!r} ({slave.description.path.name})",
            expected="a magnitude of at most 2**53",
        )
        return "failed", error.text()
    at = "from" if early_stop.what == "step" else "at"
    refused = slave.refused(f"{early_stop.what} {at} t = {seconds:g} s", early_stop.status)
    overflow = "no longer finite" in (refused.got or "")
    return ("diverged" if overflow else "failed"), refused.text()
