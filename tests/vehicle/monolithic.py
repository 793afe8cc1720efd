"""Plant, observer and links in one simulation, by SciPy: what a flight of FMUs must agree with.

Between two communication points the inputs of both are constant: the command that acts on the
plant, and the innovations that the observer holds. Both are integrated together by DOP853 with
tight tolerances; past values come from its dense output. Nothing here is taken from the product
but the numbers of the design.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Reals = NDArray[np.float64]


@dataclass
class History:
    """A function of time that grows piece by piece; constant before its first piece."""

    first: Reals
    ends: list[float] = field(default_factory=list)
    pieces: list[Any] = field(default_factory=list)

    def __call__(self, t: float) -> Reals:
        if t <= 0.0 or not self.pieces:
            return self.first
        place = min(bisect_right(self.ends, t - 1e-12), len(self.pieces) - 1)
        return np.asarray(self.pieces[place](t))

    def add(self, end: float, piece: Any) -> None:
        """Continue to `end`."""
        self.ends.append(end)
        self.pieces.append(piece)


@dataclass
class Packet:
    """A measurement that arrives: its place in the list of measurements, and when it was taken."""

    arrival: float
    measurement: int
    stamp: float


@dataclass
class Loop:
    """The numbers of plant and observer.

    Attributes
    ----------
    plant : x' of the state, its past as a function of the age, and the commands.
    start, estimate : at t <= 0.
    A, late, B : of the observer; `late` has pairs of an age and a matrix.
    C, L : of each measurement.
    K, limits : of the commands K (xh - reference), limited.
    thrust_map, allocation : (r, m) commands for a control, and (m, r) the control that they give.
    reference, disturbance : of time; constant between the points.
    output : of the plant's state, what the measurements are about, without trim.
    """

    plant: Callable[[Reals, Callable[[float], Reals], Reals], Reals]
    start: Reals
    estimate: Reals
    A: Reals
    late: Sequence[tuple[float, Reals]]
    B: Reals
    C: Sequence[Reals]
    L: Sequence[Reals]
    K: Reals
    limits: Reals
    thrust_map: Reals | None = None
    allocation: Reals | None = None
    reference: Callable[[float], Reals] | None = None
    disturbance: Callable[[float], Reals] | None = None
    output: Callable[[Reals], Reals] = lambda x: x

    def command(self, estimate: Reals, t: float) -> Reals:
        """Commands at a point."""
        off = estimate if self.reference is None else estimate - self.reference(t)
        control = self.K @ off
        wanted = control if self.thrust_map is None else self.thrust_map @ control
        return np.asarray(np.clip(wanted, -self.limits, self.limits))


def simulate(
    loop: Loop, points: Sequence[float], packets: Sequence[Packet]
) -> tuple[Reals, Reals, Reals]:
    """Return states, estimates and commands at the points, (k, n), (k, n) and (k, m)."""
    n, waiting = len(loop.start), sorted(packets, key=lambda p: (p.arrival, p.stamp))
    past = History(np.concatenate((loop.start, loop.estimate)))
    innovations = [np.zeros(len(C)) for C in loop.C]
    newest = [-1.0] * len(loop.C)
    now, command = past.first, np.zeros(len(loop.limits))
    rows = [(now[:n], now[n:], command)]
    for begin, end in pairwise(points):
        while waiting and waiting[0].arrival <= begin + 1e-9:
            packet = waiting.pop(0)
            if packet.stamp > newest[packet.measurement]:
                i, then = packet.measurement, past(packet.stamp)
                newest[i] = packet.stamp
                innovations[i] = loop.C[i] @ (loop.output(then[:n]) - then[n:])
        acting = command if loop.allocation is None else loop.allocation @ command
        known = loop.B @ acting
        outer = 0.0 if loop.disturbance is None else loop.disturbance(begin)
        inject = np.sum([L @ v for L, v in zip(loop.L, innovations, strict=True)], axis=0)

        def rates(
            t: float,
            y: Reals,
            command: Reals = command,
            given: Reals = known + inject,
            outer: Any = outer,
        ) -> Reals:
            estimate = loop.A @ y[n:] + given
            for age, matrix in loop.late:
                estimate = estimate + matrix @ past(t - age)[n:]
            moved = loop.plant(y[:n], lambda age: past(t - age)[:n], command) + outer
            return np.concatenate((moved, estimate))

        found = solve_ivp(
            rates, (begin, end), now, method="DOP853", dense_output=True, rtol=1e-11, atol=1e-13
        )
        past.add(end, found.sol)
        now = found.y[:, -1]
        command = loop.command(now[n:], begin)  # inputs are those of the step's beginning
        rows.append((now[:n], now[n:], command))
    states, estimates, commands = (np.array(column) for column in zip(*rows, strict=True))
    return states, estimates, commands
