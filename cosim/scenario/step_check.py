"""Check the communication step: run at h and at h/2, and estimate the error at h.

The error of a coupling of order p is C h^p for small h. Then y_h - y_(h/2) = (1 - 2^-p) C h^p, so
that the error at h is about the difference times 2^p / (2^p - 1) (Richardson extrapolation): twice
the difference for order 1. The order is the one that the coupling should have; with a third run at
h/4 it is observed, signal by signal: 2^p is the ratio of the two differences.

Seeds, links, events, sampled controllers and the steps of single components stay what they are.
What the FMUs' own solvers get wrong does not depend on this step and is not seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Progress, silent
from cosim.master import EngineName, Run, System, receiving_order
from cosim.network import PacketLink
from cosim.scenario.execute import assembled_system, execute_unrecorded
from cosim.scenario.link_keys import nanoseconds
from cosim.scenario.preparation import PreparedScenario
from cosim.scenario.supervision import Supervision

TOLERANCE = 0.01
"""Largest estimated error that the verdict accepts by default, as a share of a signal's range."""
_ROUNDING = 1e-12
"""A difference below this share of a signal's magnitude has no order."""
_CLEAN = (0.5, 4.0)
"""Observed orders that are used; another one shows that the error is not C h^p."""

Verdict = Literal["yes", "no", "unclear"]


@dataclass(frozen=True)
class SignalDifference:
    """How one output differs between the run at h and that at h/2.

    Attributes
    ----------
    name : `component.variable`.
    unit : as its FMU declares; None without one.
    difference, at_s : the largest |y_h - y_(h/2)|, and when [s].
    span : largest less smallest value of the finest run.
    observed_order : from a third run; None without one, or where differences are rounding.
    error : estimate of the largest error at h; None for a variable that is no real number.
    relative_error : `error` as a share of `span`, of a constant signal as one of its magnitude.
    """

    name: str
    unit: str | None
    difference: float
    at_s: float
    span: float
    observed_order: float | None
    error: float | None
    relative_error: float | None


@dataclass(frozen=True)
class StepCheck:
    """Whether the communication step of a scenario is small enough.

    Attributes
    ----------
    steps_s : h, h/2 and, if the order was observed, h/4 [s].
    statuses, ends_s : of the runs with these steps: how and when they ended [s].
    order : that the coupling should have; used where none was observed.
    tolerance : largest relative error that counts as small enough.
    signals : those with the largest relative error first.
    verdict : "unclear": a run did not finish, or differences do not shrink as those of an error
        C h^p do.
    reason : of the verdict, in words.
    """

    scenario: str
    title: str
    steps_s: tuple[float, ...]
    statuses: tuple[str, ...]
    ends_s: tuple[float, ...]
    order: int
    tolerance: float
    signals: tuple[SignalDifference, ...]
    verdict: Verdict
    reason: str

    def to_json(self) -> dict[str, Any]:
        """Return what `cosim run --check-step --json` prints."""
        return asdict(self)

    @property
    def suggested_step_s(self) -> float | None:
        """The step at which the estimate meets the tolerance [s]; None if h does, or unclear."""
        if self.verdict != "no":
            return None
        worst = self.signals[0]
        order = _used_order(worst.observed_order, self.order)
        ratio = self.tolerance / (worst.relative_error or 1.0)
        return self.steps_s[0] * math.pow(ratio, 1.0 / order)


def check_step(
    prepared: PreparedScenario,
    *,
    tolerance: float | None = None,
    observe_order: bool = False,
    progress: Progress | None = None,
    engine: EngineName = "auto",
    supervision: Supervision | None = None,
) -> StepCheck:
    """Run a scenario at its step and at half of it, and compare every output; writes no trace.

        >>> from pathlib import Path
        >>> from cosim import DelaySystem, Scenario
        >>> from cosim.scenario import FmuCache, check_step, prepare
        >>> lag = DelaySystem([[-1]], [[1]])
        >>> two = Scenario(step=0.5, until=5).add("first", lag, initial=[1.0]).add("second", lag)
        >>> loaded = two.connect("first.x", "second.u").loaded()
        >>> check = check_step(prepare(loaded, FmuCache(Path("fmus"), Path())))
        >>> check.steps_s, check.verdict, check.suggested_step_s < 0.5
        ((0.5, 0.25), 'no', True)

    Parameters
    ----------
    tolerance : largest relative error that counts as small enough; None: `TOLERANCE`.
    observe_order : also run at a quarter of the step, and use the order that is observed.
    supervision : as for `execute_run`; None: in this process.

    Raises
    ------
    InputError : a step that cannot be halved, a tolerance that is not positive; as `execute_run`.
    ComponentError : as `execute_run`.
    """
    limit = TOLERANCE if tolerance is None else tolerance
    if not 0.0 < limit < math.inf:
        raise InputError(
            "this is no tolerance", where="tolerance", expected="a positive share", got=repr(limit)
        )
    report_progress = progress or silent
    parts = (1, 2, 4) if observe_order else (1, 2)
    whole = nanoseconds(prepared.loaded.scenario.run.step)
    if whole % parts[-1]:
        raise InputError(
            f"the communication step cannot be divided by {parts[-1]}",
            where="run.step",
            expected=f"a multiple of {parts[-1]} ns, so that the runs have points in common",
            got=f"{whole} ns",
            hint=f"`set` run.step={(whole - whole % parts[-1]) / 1e9!r}",
        )
    runs = []
    for part in parts:
        step_s = whole // part / 1e9

        def report(what: str, share: float, step_s: float = step_s) -> None:
            report_progress(f"{what}, step {step_s:g} s", share)

        finer = _with_step(prepared, step_s)
        _, run = execute_unrecorded(
            finer, zero_state_run=False, progress=report, engine=engine, supervision=supervision
        )
        runs.append(run)
    order = expected_order(assembled_system(prepared)[0])
    signals = sorted(_differences(runs, order), key=lambda s: -(s.relative_error or 0.0))
    verdict, reason = _judged(runs, signals, limit)
    return StepCheck(
        scenario=prepared.loaded.name,
        title=prepared.loaded.scenario.title,
        steps_s=tuple(whole // part / 1e9 for part in parts),
        statuses=tuple(run.status for run in runs),
        ends_s=tuple(float(run.points_ns[-1]) / 1e9 if run.points_ns.size else 0.0 for run in runs),
        order=order,
        tolerance=limit,
        signals=tuple(signals),
        verdict=verdict,
        reason=reason,
    )


def expected_order(system: System) -> int:
    """Return the order of the coupling error in the communication step.

    2 where every input that comes from a component has a policy that looks ahead, or the messages
    of a packet link whose instants are communication points; 1 otherwise, also where a connection
    is cut.
    """
    if system.algorithm != "jacobi" or system.driven or receiving_order(system).cut:
        return 1
    exact = system.comm_schedule.events == "align"
    links = {name for name, link in system.links.items() if isinstance(link, PacketLink) and exact}
    signals = [c for c in system.connections if not system.is_state(c.source)]
    ahead = any(c.policy in ("midpoint", "linear") for c in signals)
    second = all(c.policy in ("midpoint", "linear") or c.link in links for c in signals)
    return 2 if ahead and second else 1


def _with_step(prepared: PreparedScenario, step_s: float) -> PreparedScenario:
    scenario = prepared.loaded.scenario
    run = scenario.run.model_copy(update={"step": step_s})
    changed = scenario.model_copy(update={"run": run})
    return replace(prepared, loaded=replace(prepared.loaded, scenario=changed))


def _differences(runs: Sequence[Run], order: int) -> Iterator[SignalDifference]:
    """Compare every output at the points that the component has in all runs."""
    for instances in zip(*(_by_name(run) for run in runs), strict=True):
        own = [
            run.points_ns[one.own_points.own[one.own_points.own < run.points_ns.size]]
            for run, one in zip(runs, instances, strict=True)
        ]
        common = own[0]
        for other in own[1:]:
            common = np.intersect1d(common, other, assume_unique=True)
        if not common.size:
            continue
        places = [np.searchsorted(run.points_ns, common) for run in runs]
        for j, column in enumerate(instances[0].output_columns):
            if column.port.kind == "string":
                continue
            values = [one.outputs[place, j] for one, place in zip(instances, places, strict=True)]
            finite = np.isfinite(values).all(axis=0)
            if finite.any():
                yield _difference(
                    f"{instances[0].name}.{column.name}",
                    column.port.unit,
                    [one[finite] for one in values],
                    common[finite] / 1e9,
                    order if column.port.kind == "float" else None,
                )


def _by_name(run: Run) -> list[Any]:
    return sorted(run.instances, key=lambda instance: instance.name)


def _difference(
    name: str,
    unit: str | None,
    values: Sequence[NDArray[np.float64]],
    seconds: NDArray[np.float64],
    order: int | None,
) -> SignalDifference:
    """Make the figures of one signal; `order` None: no error is estimated."""
    apart = np.abs(values[0] - values[1])
    place = int(np.argmax(apart))
    difference, span = float(apart[place]), float(np.ptp(values[-1]))
    size = float(np.abs(values[-1]).max())
    observed = None
    if len(values) > 2 and order is not None:
        finer = float(np.abs(values[1] - values[2]).max())
        if min(difference, finer) > _ROUNDING * size:
            observed = math.log2(difference / finer)
    error = None
    if order is not None:
        ratio = 2.0 ** _used_order(observed, order)
        error = difference * ratio / (ratio - 1.0)
    scale = span if span > 1e-9 * size else size
    relative = None
    if error is not None:
        relative = error / scale if scale > 0.0 else 0.0
    return SignalDifference(
        name, unit, difference, float(seconds[place]), span, observed, error, relative
    )


def _used_order(observed: float | None, expected: int) -> float:
    """Return the observed order if it is that of an error C h^p, else the expected one."""
    return observed if observed is not None and _CLEAN[0] <= observed <= _CLEAN[1] else expected


def _judged(
    runs: Sequence[Run], signals: Sequence[SignalDifference], tolerance: float
) -> tuple[Verdict, str]:
    if len({run.status for run in runs}) > 1 or runs[0].status in ("diverged", "failed"):
        words = [f"{run.status}" + (f" ({run.reason})" if run.reason else "") for run in runs]
        return "unclear", f"the runs ended: {', then '.join(words)}"
    if not signals:
        return "unclear", "there is no output to compare"
    worst = signals[0]
    share = f"the error of {worst.name} is about {100 * (worst.relative_error or 0.0):.2g} %"
    wild = [
        s
        for s in signals
        if s.observed_order is not None
        and s.observed_order < _CLEAN[0]
        and (s.relative_error or 0.0) > tolerance
    ]
    if wild:
        return "unclear", (
            f"{wild[0].name} changes by as much from h/2 to h/4 as from h to h/2 (observed order "
            f"{wild[0].observed_order:.2g}): the estimate does not hold"
        )
    if (worst.relative_error or 0.0) <= tolerance:
        return "yes", f"{share} of its range, within {100 * tolerance:g} %"
    return "no", f"{share} of its range, more than {100 * tolerance:g} %"
