"""The law of a controller with an observer: estimate, innovations and commands.

    xh' = A xh + sum_j A_j xh(t - d_j) + B u + sum_i L_i innovation_i,   u as it acts
    innovation_i = y_i - C_i xh(s_i)      when a packet with a newer stamp s_i is there, then held
    command = limited(trim + M K (xh - reference))      at sample instants, then held

The controller shows its estimate, its innovations and the control that it takes to act. So each of
the three can be compared with the numbers of the design, whatever FMU it is: innovations and
commands at every point, the estimate step by step as a plant's state is (`StepLaw`).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.master import ComponentInstance, Run
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.feedback_law import complement
from cosim.scenario.guarantee.step_law import Equation, StepLaw
from cosim.scenario.limits import limits_of
from cosim.scenario.measure import Measure, after, own_points_in
from cosim.scenario.measurement_ages import PacketsInUse
from cosim.scenario.performance import reader_of

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]

_CLOSE = 1e-9


def _names(letter: str, count: int) -> list[str]:
    return [f"{letter}[{i + 1}]" for i in range(count)]


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

    def equation(instance: ComponentInstance) -> Equation | None:
        ports = instance.component.description.ports
        needed = [*_names("estimate", n), *_names("applied", m), *_innovations(design)]
        if not all(name in ports for name in needed):
            return None
        step = 0.2 / roots if roots > 0 else 1.0
        return Equation(tuple(_names("estimate", n)), rates, delays, step)

    def read(instance: ComponentInstance) -> Callable[[int, int], tuple[Reals, Reals]]:
        state = reader_of(instance, _names("estimate", n))
        acting = reader_of(instance, _names("applied", m))
        steady = reader_of(instance, _innovations(design))
        return lambda first, last: (
            state.read(first, last),
            np.hstack((acting.read(first, last), steady.read(first, last))),
        )

    # an innovation is computed at the beginning of a step, and seen at its end
    return StepLaw(controller, equation, read, later=slice(m, None))


def _stacked(design: hinf.OutputFeedback) -> Reals:
    return np.vstack([one.C for one in design.measurements])


class ObserverLaw(Measure[list[Departure]]):
    """Where innovations or commands left their law for the first time; empty if they never did.

    Parameters
    ----------
    loop : of the design.
    unrecorded : as of `FeedbackLaw`.
    """

    def __init__(
        self,
        loop: DesignedLoop,
        design: hinf.OutputFeedback,
        problem: Problem,
        unrecorded: Collection[str] = (),
    ) -> None:
        self._loop, self._design, self._problem = loop, design, problem
        self._unrecorded = unrecorded
        self._packets = PacketsInUse([one.name for one in design.measurements])
        self._instance: ComponentInstance | None = None
        self._found: Departure | None = None
        self.reads_inputs = True

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Find what the controller is told, shows and commands."""
        instance = next((s for s in instances if s.name == self._loop.controller), None)
        if instance is None:
            return
        ports, start_of = instance.component.description.ports, instance.component.start_of
        design, n = self._design, len(self._design.system.A)
        values = [name for one in self._loop.measurements for name in one.inputs]
        commands = list(self._loop.commands.values())
        outputs = [*_names("estimate", n), *_innovations(design), *commands]
        needed = [*values, *outputs, *(one.stamp for one in self._loop.measurements)]
        missing = [name for name in needed if name not in ports]
        if missing:
            place = f"{self._loop.controller}.{missing[0]}"
            self._found = Departure(place, "a variable of the controller", "there is none")
            return
        self._packets.begin(instance)
        self._values = reader_of(instance, values)
        self._trims = np.array([start_of(f"trim.{name}", 0.0) for name in values], float)
        self._estimate = reader_of(instance, _names("estimate", n))
        self._innovation = reader_of(instance, _innovations(design))
        self._out = reader_of(instance, commands)
        references = [name for name in _names("reference", n) if name in ports]
        self._reference = reader_of(instance, references)
        self._watchdog = reader_of(instance, ["watchdog"]) if "watchdog" in ports else None
        self._commands = commands
        note = self._problem.plant
        self._K = np.asarray(design.K, dtype=np.float64)
        self._trim = np.zeros(len(commands))
        if note is not None:
            self._trim = np.array(note.control.trim, float)
            if note.thrust_map:
                self._K = np.array(note.thrust_map, float) @ self._K
        moved = [j for j in range(n) if f"reference[{j + 1}]" in self._unrecorded]
        self._judged = complement(self._K[:, moved])
        limits = limits_of(ports)
        self._bounds = np.array(
            [start_of(limits[c], np.inf) if c in limits else np.inf for c in commands], float
        )
        self._period = round(float(start_of("sample_time", 0.0)) * 1e9)
        self._kept: tuple[Reals | None, ...] = (None,) * 6
        self._times = np.zeros(0, np.int64)
        self._past = np.zeros((0, n))
        self._instance = instance

    def add(self, first: int, last: int) -> None:
        """Compare innovations and commands at the points."""
        if self._instance is None or self._found is not None:
            return
        blocks = [
            reader.read(first, last)
            for reader in (
                *(self._values, self._estimate, self._innovation, self._out, self._reference),
                *(() if self._watchdog is None else (self._watchdog,)),
            )
        ]
        own = own_points_in(self._instance, first, last)
        used = self._packets.add(first, last)
        if not own.size:
            return
        points = self._instance.comm_points.points_ns[own]
        here = [block[own - first] for block in blocks]
        if len(here) == 5:
            here.append(np.zeros((own.size, 1)))
        joined = [after(a, b) for a, b in zip(self._kept, here, strict=True)]
        begun = self._times[-1:] if self._times.size else None
        times = after(begun, points)
        self._kept = tuple(block[-1:].copy() for block in joined)
        self._times = np.concatenate((self._times, points))
        self._past = np.vstack((self._past, here[1]))
        if times.size < 2 or used is None:
            return
        y, xh, innovation, out, reference, watchdog = joined
        self._compare_innovations(times, y - self._trims, innovation, used[2])
        self._compare_commands(times, xh, out, reference, watchdog)
        oldest = int(used[2][-1].min())
        kept = max(0, int(np.searchsorted(self._times, oldest, side="right")) - 2)
        kept = min(kept, self._times.size - 1)
        self._times, self._past = self._times[kept:], self._past[kept:]

    def _compare_innovations(
        self, times: Integers, y: Reals, innovation: Reals, used: Integers
    ) -> None:
        column = 0
        for j, one in enumerate(self._design.measurements):
            mine = slice(column, column + len(one.C))
            column = mine.stop
            new = used[1:, j] > used[:-1, j]
            steady = np.flatnonzero(~new)
            same = innovation[steady + 1, mine] == innovation[steady, mine]
            if not same.all() and self._found is None:
                k = int(steady[np.flatnonzero(~same.all(axis=1))[0]])
                self._depart(one.name, times[k + 1], innovation[k, mine], innovation[k + 1, mine])
            comes = np.flatnonzero(new)
            if not comes.size:
                continue
            stored, allowed = self._stored(used[comes + 1, j])
            values, outputs = y[comes, mine], innovation[comes + 1, mine]
            wanted = values - stored @ one.C.T
            size = np.abs(stored) @ np.abs(one.C).T + np.abs(values) + 1e-12
            wrong = (np.abs(wanted - outputs) > allowed[:, None] * size).any(axis=1)
            if wrong.any():
                k = int(np.argmax(wrong))
                self._depart(one.name, times[comes[k] + 1], wanted[k], outputs[k])

    def _stored(self, stamps: Integers) -> tuple[Reals, Reals]:
        """Return the estimates at stamps, constant before the first point, and their accuracy."""
        times = self._times
        place = np.clip(np.searchsorted(times, stamps, side="right") - 1, 0, times.size - 2)
        share = (stamps - times[place]) / (times[place + 1] - times[place])
        share = np.clip(share, 0.0, 1.0)
        there = (share == 0.0) | (share == 1.0)
        found = (1 - share)[:, None] * self._past[place] + share[:, None] * self._past[place + 1]
        # between points the recorded estimates are interpolated
        return found, np.where(there, _CLOSE, 1e-2)

    def _depart(self, name: str, at: int, wanted: Reals, got: Reals) -> None:
        if self._found is not None or self._instance is None:
            return
        j = int(np.argmax(np.abs(wanted - got)))
        place = f"{self._loop.controller}.innovation.{name}[{j + 1}]"
        expected = f"{wanted[j]:.9g}, the measurement against the estimate of its time"
        seconds = self._instance.comm_points.at_s(int(at))
        self._found = Departure(place, expected, f"{got[j]:.9g}", seconds)

    def _compare_commands(
        self, times: Integers, xh: Reals, out: Reals, reference: Reals, watchdog: Reals
    ) -> None:
        if self._found is not None or self._instance is None:
            return
        error = xh[1:].copy()
        if reference.shape[1] == error.shape[1]:
            error -= reference[:-1]
        wanted = np.clip(error @ self._K.T + self._trim, -self._bounds, self._bounds)
        allowed = _CLOSE * (np.abs(error) @ np.abs(self._K).T + np.abs(self._trim))
        due = np.ones(len(error), bool)
        if self._period > 0:
            due = times[1:] // self._period > times[:-1] // self._period
        wanted = np.where(due[:, None], wanted, out[:-1])
        safe = watchdog[1:, 0] != 0
        apart = np.abs((wanted - out[1:]) @ self._judged)
        wrong = (apart > np.where(due[:, None], allowed, 0.0)) | safe[:, None]
        if not wrong.any():
            return
        k, j = (int(x) for x in np.argwhere(wrong)[0])
        got = f"{out[k + 1, j]:.9g}" + (", a safe value: a measurement is too old" * bool(safe[k]))
        place = f"{self._loop.controller}.{self._commands[j]}"
        expected = f"{wanted[k, j]:.9g}, K of the design times the estimate"
        at = self._instance.comm_points.at_s(int(times[k + 1]))
        self._found = Departure(place, expected, got, at)

    def result(self, run: Run) -> list[Departure]:
        """Return where the law was left."""
        del run
        return [] if self._found is None else [self._found]
