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
from cosim.scenario.guarantee.measured_noise import columns_of
from cosim.scenario.guarantee.step_law import Equation, StepLaw
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import sample_period_ns
from cosim.scenario.measurement_ages import PacketsInUse
from cosim.scenario.performance import elements
from cosim.scenario.signal_reader import History, OwnRows

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]


def _innovations(design: hinf.OutputFeedback) -> list[str]:
    return [
        f"innovation.{one.name}[{i + 1}]" for one in design.measurements for i in range(len(one.C))
    ]


def estimate_law(design: hinf.OutputFeedback, controller: str) -> StepLaw:
    """Return the measure of the estimate's equation."""
    system = design.system
    n, m = system.B.shape
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

    names = elements("estimate", n), elements("applied", m), _innovations(design)
    step = 0.2 / roots if roots > 0 else 1.0
    equation = Equation(names[0], rates, delays, step)

    def read(instance: ComponentInstance) -> tuple[Equation, OwnRows]:
        return equation, OwnRows(instance, names[0], [*names[1], *names[2]])

    # an innovation is computed at the beginning of a step, and seen at its end
    return StepLaw(controller, read, [x for group in names for x in group], later=slice(m, None))


def _stacked(design: hinf.OutputFeedback) -> Reals:
    return np.vstack([one.C for one in design.measurements])


class ObserverLaw(FirstDeparture):
    """Where innovations or commands left their law for the first time; empty if they never did.

    Parameters
    ----------
    loop : of the design.
    packets : in use by the controller.
    unrecorded : as of `FeedbackLaw`.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        design: hinf.OutputFeedback,
        problem: Problem,
        packets: PacketsInUse,
        unrecorded: Collection[str] = (),
    ) -> None:
        n, note = len(design.system.A), problem.plant
        self._commands = list(loop.commands.values())
        self._values = [name for one in loop.measurements for name in one.inputs]
        self._answers = elements("estimate", n), _innovations(design), self._commands
        stamps = [one.stamp for one in loop.measurements]
        answers = [name for group in self._answers for name in group]
        super().__init__(loop.controller, [*self._values, *answers, *stamps])
        self._design, self._packets = design, packets
        self._K = np.asarray(design.K, dtype=np.float64)
        self._trim = np.zeros(len(self._commands))
        if note is not None:
            self._trim = np.array(note.control.trim, float)
            if note.thrust_map:
                self._K = np.array(note.thrust_map, float) @ self._K
        self._set_points = elements("reference", n)
        moved = [j for j, name in enumerate(self._set_points) if name in unrecorded]
        self._judged = unexplained_by(self._K[:, moved])
        self._estimates = History()

    def bind(self, instance: ComponentInstance) -> None:
        """Find what the controller is told, shows and commands."""
        start_of, ports = instance.component.start_of, instance.component.description.ports
        self._packets.begin(instance)
        self._trims = np.array([start_of(f"trim.{name}", 0.0) for name in self._values], float)
        given = [name for name in self._set_points if name in ports]
        watchdog = [name for name in ("watchdog",) if name in ports]
        self._rows = OwnRows(instance, self._values, *self._answers, given, watchdog)
        self._bounds = bounds_of(instance, self._commands)
        self._period = sample_period_ns(instance.component)

    def compare(self, first: int, last: int) -> None:
        """Compare innovations and commands at the points."""
        times, (y, xh, innovation, out, reference, watchdog) = self._rows.read(first, last)
        known = min(self._estimates.times.size, 1)  # a row of the block before stands first
        self._estimates.add(times[known:], xh[known:])
        packets = self._packets.add(first, last)
        if packets is None:
            return
        used = packets[2]
        self._compare_innovations(times, y - self._trims, innovation, used)
        safe = (watchdog[1:] != 0).any(axis=1)
        self._compare_commands(times, xh, out, reference, np.asarray(safe))
        self._estimates.forget(int(used[-1].min()))

    def _compare_innovations(
        self, times: Integers, y: Reals, innovation: Reals, used: Integers
    ) -> None:
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
            values, outputs = y[comes, mine], innovation[comes + 1, mine]
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

    def _compare_commands(
        self, times: Integers, xh: Reals, out: Reals, reference: Reals, safe: NDArray[np.bool_]
    ) -> None:
        error = xh[1:].copy()
        if reference.shape[1] == error.shape[1]:
            error -= reference[:-1]
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
        self.depart(self._commands[j], expected, got, int(times[k + 1]))
