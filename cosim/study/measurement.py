"""The metrics that a study takes from each run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master import Run
from cosim.scenario import ExpressionError, formula, inside, kind_of, split
from cosim.study.consistency import nowhere
from cosim.study.schema import Metric

_FROM_ZERO_STATE_RUN = (
    "metrics.gain",
    "metrics.norm_reached",
    "metrics.gain_within_gamma",
    "metrics.envelope_use",
    "metrics.outages.weighted_gain",  # and whether it is within gamma
    "metrics.assumptions.state_inside_envelope",
    "metrics.assumptions.limits_not_reached",
    "metrics.guarantee_claimed",
)
"""Figures that are taken from the run and its zero-state run together."""

Reals = NDArray[np.float64]
Value = float | int | bool | str | None


def needs_zero_state_run(metrics: Mapping[str, Metric]) -> bool:
    """Return whether any of the figures is taken from the zero-state run too."""
    return any((metric.path or "").startswith(_FROM_ZERO_STATE_RUN) for metric in metrics.values())


def measure(
    metric: Metric, outcome: Mapping[str, Any], run: Run, before: Mapping[str, Value] | None = None
) -> Value:
    """Return one figure of a run; None if it does not exist.

    outcome : the data of `Outcome.to_json`.
    before : the metrics before this one, by name.

    Raises
    ------
    InputError : no such figure or signal; or it is not a single value.
    """
    if metric.path is not None:
        value = value_at(outcome, metric.path)
        if isinstance(value, (dict, list)):
            raise InputError(
                "a metric must be a single value",
                where=metric.path,
                expected="a number, a text, true or false",
                got=f"a table of {', '.join(map(str, value))}"[:200],
            )
    elif metric.value is not None:
        value = _computed(metric.value, before or {})
    else:
        value = _reduced(metric, run)
    return _asked(metric, value) if metric.asks else value


def _computed(text: str, before: Mapping[str, Value]) -> float | None:
    """Return the value of an expression of metrics; None where one is missing, or it has none."""
    bound = formula(text, *before)
    known = {name: before[name] for name in bound.names}
    if any(value is None for value in known.values()):
        return None
    try:
        return bound.number(**known)
    except ExpressionError:
        if any(isinstance(value, str) for value in known.values()):
            raise
        return None


def value_at(data: Any, path: str) -> Any:
    """Return the value at a dotted path (`links.uplink.max_age_s`); keys may contain dots.

    Raises
    ------
    InputError : there is no such value; the message names similar keys.
    """
    here, rest = data, list(_keys_of(path))
    while rest:
        if here is None:
            return None
        if isinstance(rest[0], int):
            here = inside(here, rest.pop(0), path)
            continue
        if not isinstance(here, Mapping):
            raise InputError(
                f"{rest[0]!r} is looked up in a value that is not a table",
                where=path,
                got=kind_of(here),
            )
        # the longest key that fits, as values by `component.variable` are one table
        for n in range(len(rest), 0, -1):
            key = nowhere(*rest[:n])
            if key in here:
                here, rest = here[key], rest[n:]
                break
        else:
            raise InputError.unknown("figure", nowhere(*rest), here, where=path)
    return here


_keys_of = cache(split)


def _asked(metric: Metric, value: Value) -> bool:
    if value is None:
        return False
    if metric.equals is not None and value != metric.equals:
        return False
    for bound, within in ((metric.below, float.__lt__), (metric.above, float.__gt__)):
        if bound is not None:
            if not isinstance(value, (int, float)):
                raise InputError(
                    "below and above need a number", where=metric.path, got=repr(value)
                )
            if not within(float(value), float(bound)):
                return False
    return True


def _reduced(metric: Metric, run: Run) -> float | None:
    t = run.points_ns / 1e9
    columns = []
    for name in metric.signals:
        component, _, variable = name.partition(".")
        columns.append(run.signal(component, variable) - metric.to)
    e = columns[0] if len(columns) == 1 else np.sqrt(np.sum(np.square(columns), axis=0))
    if metric.after > 0.0:
        late = t >= metric.after
        t, e = t[late], e[late]
    if t.size == 0:
        return None
    if metric.reduce == "settling_time":
        return _settling_time(t, e, metric.within or 0.0, run)
    value = _REDUCTIONS[metric.reduce or "final"](t, e)
    return None if value is None or math.isnan(value) else value


def _rms(t: Reals, e: Reals) -> float:
    if t.size == 1:
        return abs(float(e[0]))
    with np.errstate(over="ignore"):
        return math.sqrt(float(np.trapezoid(e**2, t)) / float(t[-1] - t[0]))


def _mean(t: Reals, e: Reals) -> float:
    return float(e[0]) if t.size == 1 else float(np.trapezoid(e, t)) / float(t[-1] - t[0])


def _growth_rate(t: Reals, e: Reals) -> float | None:
    """Return the exponent [1/s] from the rms of two halves; exact for an exponential."""
    middle = int(np.searchsorted(t, 0.5 * (t[0] + t[-1])))
    if middle < 1 or middle >= t.size - 1:
        return None
    first, second = _rms(t[: middle + 1], e[: middle + 1]), _rms(t[middle:], e[middle:])
    if first == 0.0 or second == 0.0 or not math.isfinite(second):
        return None
    return math.log(second / first) / (0.5 * float(t[-1] - t[0]))


def _settling_time(t: Reals, e: Reals, band: float, run: Run) -> float | None:
    """Return the time until |e| stays inside the band; None if it does not."""
    outside = np.flatnonzero(~(np.abs(e) <= band))
    if run.status != "finished" or (outside.size and outside[-1] == t.size - 1):
        return None
    return float(t[outside[-1] + 1] - t[0]) if outside.size else 0.0


_REDUCTIONS: dict[str, Callable[[Reals, Reals], float | None]] = {
    "max_abs": lambda _t, e: float(np.abs(e).max()),
    "rms": _rms,
    "mean": _mean,
    "minimum": lambda _t, e: float(e.min()),
    "maximum": lambda _t, e: float(e.max()),
    "final": lambda _t, e: float(e[-1]),
    "growth_rate": _growth_rate,
}
