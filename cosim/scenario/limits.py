"""Saturation of the commands of a run, and whether it was a limit cycle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master import Run

_SHARED = {
    "force.x": "limit.force",
    "force.y": "limit.force",
    "force.z": "limit.force",
    "moment.z": "limit.moment",
}
"""Limits of the vehicle's commands; any other command has its own, `limit.` and its name."""

_REVERSALS = 4


@dataclass(frozen=True)
class Saturation:
    """Saturation of the commands of one run.

    Attributes
    ----------
    fraction : share of the time in which at least one command was at its limit.
    largest : command name -> largest magnitude [N, N m].
    limit_cycle : in the last quarter of the run commands were at their limits more than half
        of the time, and one of them went from one limit to the other at least four times: the
        limits, not the feedback, bound the motion.
    """

    fraction: float
    largest: dict[str, float]
    limit_cycle: bool


def saturation(run: Run, controller: str) -> Saturation | None:
    """Return the saturation of a controller's commands; None if it has no limits."""
    instance = next((s for s in run.instances if s.name == controller), None)
    if instance is None or run.points_ns.size < 2:
        return None
    ports = instance.component.description.ports
    limit_of = {name: _SHARED.get(name, f"limit.{name}") for name in ports}
    saturable = [name for name, limit in limit_of.items() if limit in ports]
    if not saturable:
        return None
    parameters = instance.component.parameters
    bounds = np.array(
        [parameters.get(limit_of[n], ports[limit_of[n]].start or 0.0) for n in saturable]
    )
    commands = np.column_stack([run.signal(controller, n) for n in saturable])
    duration = np.diff(run.points_ns).astype(float)
    at_limit = np.abs(commands) >= bounds * (1 - 1e-12)
    last_quarter = run.points_ns[:-1] >= run.points_ns[-1] * 3 // 4
    late = at_limit[:-1][last_quarter]
    cycling = _share(late.any(axis=1), duration[last_quarter]) > 0.5 and any(
        _alternates(commands[:-1][last_quarter, j], late[:, j]) for j in range(len(saturable))
    )
    return Saturation(
        fraction=_share(at_limit[:-1].any(axis=1), duration),
        largest={n: float(np.abs(commands[:, j]).max()) for j, n in enumerate(saturable)},
        limit_cycle=cycling,
    )


def _share(where: Any, duration: NDArray[np.float64]) -> float:
    total = float(duration.sum())
    return float(duration[where].sum()) / total if total else 0.0


def _alternates(command: NDArray[np.float64], at_limit: NDArray[np.bool_]) -> bool:
    sides = np.sign(command[at_limit])
    return int(np.count_nonzero(np.diff(sides))) >= _REVERSALS
