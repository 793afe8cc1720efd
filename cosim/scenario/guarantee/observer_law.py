"""The law of a controller with an observer: estimate, innovations and commands.

    xh' = A xh + sum_j A_j xh(t - d_j) + B u + sum_i L_i innovation_i,   u as it acts
    innovation_i = y_i - C_i xh(s_i)      when a packet with a newer stamp s_i is there, then held
    command = limited(trim + M K (xh - reference))      at sample instants, then held

The controller shows its estimate, its innovations and the control that it takes to act. So each of
the three can be compared with the numbers of the design, whatever FMU it is: innovations and
commands at every point, the estimate step by step as a plant's state is (`StepLaw`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import ComponentInstance
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.first_departure import CLOSE, FirstDeparture, unexplained_by
from cosim.scenario.guarantee.observer_rows import ObserverBlock, ObserverRows, columns_of
from cosim.scenario.guarantee.step_law import Equation, ReadRows, StepLaw
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import sample_period_ns
from cosim.scenario.signal_reader import History

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


def estimate_law(design: hinf.Result, controller: str, rows: ObserverRows) -> StepLaw:
    """Return the measure of the estimate's equation."""
    system = design.system
    m = system.B.shape[1]
    late = [x for x in system.delays if x.A.any()]
    terms = [system.A, *(x.A for x in late)]
    injection = np.hstack(design.L)
    delays = tuple(x.d for x in late)
    roots = max(float(np.linalg.norm(A, 2)) for A in [*terms, injection @ _stacked(design)])

    def rates(
        t: Reals, x: Sequence[Reals], past: Sequence[Sequence[Reals]], u: Sequence[Reals]
    ) -> list[Reals]:
        del t
        moved = sum(A @ np.array(v) for A, v in zip(terms, (x, *past), strict=True))
        u_ = np.array(u)
        return list(moved + system.B @ u_[:m] + injection @ u_[m:])

    equation = Equation(rows.estimate, rates, delays, 0.2 / roots if roots > 0 else 1.0)

    def read(first: int, last: int) -> tuple[Integers, Sequence[Reals]]:
        block = rows.read(first, last)
        return block.times, (block.estimate, block.applied, block.innovation)

    def bound(instance: ComponentInstance) -> tuple[Equation, ReadRows]:
        rows.begin(instance)
        return equation, read

    needed = [*rows.estimate, *rows.applied, *rows.innovation]
    # an innovation is computed at the beginning of a step, and seen at its end
    return StepLaw(controller, bound, needed, later=slice(m, None))


def _stacked(design: hinf.Result) -> Reals:
    return np.vstack([one.C for one in design.measurements])


class ObserverLaw(FirstDeparture):
    """Where innovations or commands left their law for the first time; empty if they never did.

    Parameters
    ----------
    loop : of the design.
    rows : of the controller.
    unrecorded : as of `FeedbackLaw`.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        design: hinf.Result,
        problem: Problem,
        rows: ObserverRows,
        unrecorded: Collection[str] = (),
    ) -> None:
        needed = [*rows.y, *rows.estimate, *rows.innovation, *rows.command, *rows.stamps]
        super().__init__(loop.controller, needed)
        self._design, self._rows, note = design, rows, problem.plant
        self._K = np.asarray(design.K, dtype=np.float64)
        self._trim = np.zeros(len(rows.command))
        if note is not None:
            self._trim = np.array(note.control.trim, float)
            if note.thrust_map:
                self._K = np.array(note.thrust_map, float) @ self._K
        moved = [j for j, name in enumerate(rows.set_point) if name in unrecorded]
        self._judged = unexplained_by(self._K[:, moved])
        self._estimates = History()

    def bind(self, instance: ComponentInstance) -> None:
        """Find what the controller is told, shows and commands."""
        self._rows.begin(instance)
        self._bounds = bounds_of(instance, self._rows.command)
        self._period = sample_period_ns(instance.component)

    def compare(self, first: int, last: int) -> None:
        """Compare innovations and commands at the points."""
        block = self._rows.read(first, last)
        self._estimates.continue_with(block.times, block.estimate)
        if block.packets is None:
            return
        used = block.packets[2]
        self._compare_innovations(block, used)
        self._compare_commands(block)
        self._estimates.forget(int(used[-1].min()))

    def _compare_innovations(self, block: ObserverBlock, used: Integers) -> None:
        times, innovation = block.times, block.innovation
        for j, (one, mine) in enumerate(columns_of(self._design.measurements)):
            new = used[1:, j] > used[:-1, j]
            steady = np.flatnonzero(~new)
            same = innovation[steady + 1, mine] == innovation[steady, mine]
            if not same.all():
                k = int(steady[np.flatnonzero(~same.all(axis=1))[0]])
                self._note(one.name, times[k + 1], innovation[k, mine], innovation[k + 1, mine])
            comes = np.flatnonzero(new)
            if not comes.size:
                continue
            stored, between = self._estimates.at(used[comes + 1, j])
            values, outputs = block.y[comes, mine], innovation[comes + 1, mine]
            wanted = values - stored @ one.C.T
            # between points the recorded estimates are interpolated
            allowed = np.where(between, 1e-2, CLOSE)
            size = np.abs(stored) @ np.abs(one.C).T + np.abs(values) + 1e-12
            wrong = (np.abs(wanted - outputs) > allowed[:, None] * size).any(axis=1)
            if wrong.any():
                k = int(np.argmax(wrong))
                self._note(one.name, times[comes[k] + 1], wanted[k], outputs[k])

    def _note(self, name: str, at_ns: int, wanted: Reals, got: Reals) -> None:
        j = int(np.argmax(np.abs(wanted - got)))
        expected = f"{wanted[j]:.9g}, the measurement against the estimate of its time"
        self.depart(f"innovation.{name}[{j + 1}]", expected, f"{got[j]:.9g}", at_ns)

    def _compare_commands(self, block: ObserverBlock) -> None:
        times, out, safe = block.times, block.command, block.safe[1:]
        error = block.estimate[1:].copy()
        if block.set_point.shape[1] == error.shape[1]:
            error -= block.set_point[:-1]
        wanted = np.clip(error @ self._K.T + self._trim, -self._bounds, self._bounds)
        allowed = CLOSE * (np.abs(error) @ np.abs(self._K).T + np.abs(self._trim))
        due = np.ones(len(error), bool)
        if self._period > 0:
            due = times[1:] // self._period > times[:-1] // self._period
        wanted = np.where(due[:, None], wanted, out[:-1])
        apart = np.abs((wanted - out[1:]) @ self._judged)
        wrong = (apart > np.where(due[:, None], allowed, 0.0)) | safe[:, None]
        if not wrong.any():
            return
        k, j = (int(x) for x in np.argwhere(wrong)[0])
        got = f"{out[k + 1, j]:.9g}" + (", a safe value: a measurement is too old" * bool(safe[k]))
        expected = f"{wanted[k, j]:.9g}, K of the design times the estimate"
        self.depart(self._rows.command[j], expected, got, int(times[k + 1]))
