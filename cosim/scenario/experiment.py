"""The times of a run, from the default experiments of its FMUs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import floor, isfinite, lcm, log10

from cosim.fmu import FmuDescription

USUAL_SPAN, USUAL_STEP = 10.0, 0.01
"""How long a run lasts and how long its steps are, where no FMU says so [s]."""
MOST_STEPS = 100_000
"""Steps of a new scenario: it runs at once, and its author makes it longer."""
_MOST_NS = 1 << 62


@dataclass(frozen=True)
class Experiment:
    """Start, end and steps [ns].

    Attributes
    ----------
    own_steps : component -> its communication step, where it is longer than that of the run.
    step_from : the components that declare the step of the run.
    odd : component -> a step that it declares, which is no multiple of the run's.
    is_cut : the FMUs declare a later end.
    """

    start_ns: int
    end_ns: int
    step_ns: int
    own_steps: Mapping[str, int]
    step_from: tuple[str, ...]
    odd: Mapping[str, int]
    is_cut: bool


def experiment_of(fmus: Mapping[str, FmuDescription]) -> Experiment:
    """Return the times of a run of these components.

    The least declared step is that of the run; longer ones that are multiples of it are their
    components' own. Without any it is a thousandth of the run, or 10 ms. The run begins where the
    FMUs agree that it does, else at 0, and ends with the latest that they declare.
    """
    declared = {name: fmu.model.experiment_times for name, fmu in fmus.items()}
    steps = {name: _ns(found.get("stepSize")) for name, found in declared.items()}
    steps = {name: step for name, step in steps.items() if step > 0}
    starts = {_ns(found.get("startTime", 0.0)) for found in declared.values()}
    start = max(starts.pop(), 0) if len(starts) == 1 else 0
    ends = [end for found in declared.values() if (end := _ns(found.get("stopTime"))) > start]
    span = max(ends) - start if ends else _ns(USUAL_SPAN)
    step = min(steps.values(), default=0) or _round(span / 1000 if ends else _ns(USUAL_STEP))
    own = {name: one for name, one in steps.items() if one > step and one % step == 0}
    common = lcm(*own.values(), step)
    if common > max(span, step):  # the run would have to be longer for all of them to end with it
        own, common = {}, step
    most = max(MOST_STEPS * step // common, 1)
    count = max(round(span / common), 1)
    return Experiment(
        start_ns=start,
        end_ns=start + min(count, most) * common,
        step_ns=step,
        own_steps=own,
        step_from=tuple(name for name, one in steps.items() if one == step),
        odd={name: one for name, one in steps.items() if one % step or (one > step and not own)},
        is_cut=count > most,
    )


def _ns(seconds: float | None) -> int:
    """Return a time in whole nanoseconds; 0 for none, and for what no run can have."""
    if seconds is None or not isfinite(seconds) or abs(seconds) * 1e9 > _MOST_NS:
        return 0
    return round(seconds * 1e9)


def _round(ns: float) -> int:
    """Return 1, 2 or 5 times a power of ten that is not above a time, at least 1 ns."""
    size = 10.0 ** floor(log10(max(ns, 1.0)))
    return round(max(one * size for one in (1, 2, 5) if one * size <= max(ns, 1.0)))
