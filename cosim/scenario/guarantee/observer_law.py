"""The law of a controller with an observer: estimate, innovations and commands.

    xh' = A xh + sum_j A_j xh(t - d_j) + B u + sum_i L_i innovation_i,   u as it acts
    innovation_i = y_i - C_i xh(s_i)      when a packet with a newer stamp s_i is there, then held
    command = limited(trim + M K (xh - reference))      at sample instants, then held

The controller shows its estimate, its innovations and the control that it takes to act. So each of
the three can be compared with the numbers of the design, whatever FMU it is: innovations and
commands at every point, the estimate step by step as a plant's state is (`step_law`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.scenario.gain import Problem
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.first_departure import CLOSE, departed, lacking, unexplained_by
from cosim.scenario.guarantee.observer_rows import ObserverBlock, ObserverRows, columns_of
from cosim.scenario.guarantee.step_law import Equation, OwnRows, step_law
from cosim.scenario.limits import bounds_of
from cosim.scenario.measure import Fold, MeasuredRun, measure, sample_period_ns
from cosim.scenario.signal_reader import Block, History

Reals = NDArray[np.float64]

_Left = Iterator[tuple[str, str, str, int]]
"""Variable, what was expected and got, and when [ns]."""


@measure
def estimate_law(
    run: MeasuredRun, loop: DesignedLoop, design: hinf.Result
) -> Fold[list[Departure]]:
    """Measure where the estimate left its equation for the first time; empty if it never did."""
    system = design.system
    m = system.B.shape[1]
    late = [x for x in system.delays if x.A.any()]
    terms = [system.A, *(x.A for x in late)]
    injection = np.hstack(design.L)
    delays = tuple(x.d for x in late)
    stacked = np.vstack([one.C for one in design.measurements])
    roots = max(float(np.linalg.norm(A, 2)) for A in [*terms, injection @ stacked])

    def rates(
        t: Reals, x: Sequence[Reals], past: Sequence[Sequence[Reals]], u: Sequence[Reals]
    ) -> list[Reals]:
        del t
        moved = sum(A @ np.array(v) for A, v in zip(terms, (x, *past), strict=True))
        u_ = np.array(u)
        return list(moved + system.B @ u_[:m] + injection @ u_[m:])

    instance, rows = run.instances[loop.controller], run.shared(ObserverRows, loop, design)
    if missing := lacking(instance, [*rows.estimate, *rows.applied, *rows.innovation]):
        return missing

    def own_rows(block: Block) -> OwnRows:
        at = rows.read(block)
        return at.times, np.hstack((at.estimate, at.applied, at.innovation))

    equation = Equation(rows.estimate, rates, delays, 0.2 / roots if roots > 0 else 1.0)
    # an innovation is computed at the beginning of a step, and seen at its end
    return (yield from step_law(instance, equation, own_rows, later=slice(m, None)))


@measure
def observer_law(
    run: MeasuredRun,
    loop: DesignedLoop,
    design: hinf.Result,
    problem: Problem,
    unrecorded: Collection[str] = (),
) -> Fold[list[Departure]]:
    """Measure where innovations or commands left their law first; empty if they never did.

    Parameters
    ----------
    loop : of the design.
    unrecorded : as of `feedback_law`.
    """
    instance, rows = run.instances[loop.controller], run.shared(ObserverRows, loop, design)
    needed = *rows.y, *rows.estimate, *rows.innovation, *rows.command
    if missing := lacking(instance, [*needed, *(one.stamp for one in loop.measurements)]):
        return missing
    K, trim = np.asarray(design.K, dtype=np.float64), np.zeros(len(rows.command))
    if problem.plant is not None:
        trim = np.array(problem.plant.control.trim, float)
        if problem.plant.thrust_map:
            K = np.array(problem.plant.thrust_map, float) @ K
    moved = [j for j, name in enumerate(rows.set_point) if name in unrecorded]
    commands = _Commands(
        *(rows.command, K, trim, unexplained_by(K[:, moved])),
        bounds_of(instance, rows.command),
        sample_period_ns(instance.component),
    )
    estimates = History()
    while block := (yield):
        at = rows.read(block)
        estimates.add(at.times, at.estimate)
        left = next(chain(_innovations(design, estimates, at), commands.compared(at)), None)
        if left is not None:
            return departed(instance, *left)
        estimates.forget(int(at.used[-1].min()))
    return []


def _innovations(design: hinf.Result, estimates: History, at: ObserverBlock) -> _Left:
    """Yield innovations that are not held, or not those of the packet that comes into use."""
    times, innovation, used = at.times, at.innovation, at.used
    for j, (one, mine) in enumerate(columns_of(design.measurements)):
        new = used[1:, j] > used[:-1, j]
        before, after = innovation[:-1, mine], innovation[1:, mine]
        changed = ~new & (before != after).any(axis=1)
        if changed.any():
            k = int(np.argmax(changed))
            yield _innovation(one.name, times[k + 1], before[k], after[k])
        comes = np.flatnonzero(new)
        if not comes.size:
            continue
        stored, between = estimates.at(used[comes + 1, j])
        values, outputs = at.y[comes, mine], after[comes]
        wanted = values - stored @ one.C.T
        # between points the recorded estimates are interpolated
        allowed = np.where(between, 1e-2, CLOSE)
        size = np.abs(stored) @ np.abs(one.C).T + np.abs(values) + 1e-12
        wrong = (np.abs(wanted - outputs) > allowed[:, None] * size).any(axis=1)
        if wrong.any():
            k = int(np.argmax(wrong))
            yield _innovation(one.name, times[comes[k] + 1], wanted[k], outputs[k])


def _innovation(name: str, at_ns: int, wanted: Reals, got: Reals) -> tuple[str, str, str, int]:
    j = int(np.argmax(np.abs(wanted - got)))
    expected = f"{wanted[j]:.9g}, the measurement against the estimate of its time"
    return f"innovation.{name}[{j + 1}]", expected, f"{got[j]:.9g}", at_ns


class _Commands(NamedTuple):
    """The law of the commands: limited(trim + K (estimate - set-point)), at sample instants.

    judged : the part of an error that no unrecorded set-point explains.
    """

    names: Sequence[str]
    K: Reals
    trim: Reals
    judged: Reals
    bounds: Reals
    period_ns: int

    def compared(self, at: ObserverBlock) -> _Left:
        """Yield the first command that is another one."""
        times, out, safe = at.times, at.command, (at.watchdog[1:] != 0).any(axis=1)
        error = at.estimate[1:].copy()
        if at.set_point.shape[1] == error.shape[1]:
            error -= at.set_point[:-1]
        wanted = np.clip(error @ self.K.T + self.trim, -self.bounds, self.bounds)
        allowed = CLOSE * (np.abs(error) @ np.abs(self.K).T + np.abs(self.trim))
        due = np.ones(len(error), bool)
        if self.period_ns > 0:
            due = np.diff(times // self.period_ns) > 0
        wanted = np.where(due[:, None], wanted, out[:-1])
        apart = np.abs((wanted - out[1:]) @ self.judged)
        wrong = (apart > np.where(due[:, None], allowed, 0.0)) | safe[:, None]
        if wrong.any():
            k, j = (int(x) for x in np.argwhere(wrong)[0])
            got = f"{out[k + 1, j]:.9g}"
            got += ", a safe value: a measurement is too old" * bool(safe[k])
            expected = f"{wanted[k, j]:.9g}, K of the design times the estimate"
            yield self.names[j], expected, got, int(times[k + 1])
