"""How long a run was, and the figures it is judged by, the same in every view."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from cosim.core import at_most
from cosim.trace.outcome.wordings import number_in

ABSENT = "–"
_THRUSTS = ("force.", "thruster.")


def duration_words(simulated_s: float, wall_s: float | None, steps: int | None) -> str:
    """Return how long a run was."""
    # a trace has three decimals: rounded twice here, so that every view has the same digits
    took = "" if wall_s is None else f" in {round(wall_s, 3):.2g} s"
    done = "" if steps is None else f", {steps} communication steps"
    return f"{simulated_s:g} s simulated{took}{done}"


def key_figures(metrics: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Return the label, the value, and how it was obtained, of each figure of a run.

    `metrics` : of its outcome; a figure that a run does not have is `ABSENT`.
    """
    largest, use = _numbers(metrics, "largest_command"), _numbers(metrics, "envelope_use")
    thrust = max((v for n, v in largest.items() if n.startswith(_THRUSTS)), default=None)
    gamma = number_in(metrics, "gamma")

    def figure(key: str, digits: int, unit: str = "") -> str:
        return _text(number_in(metrics, key), digits, unit)

    return [
        ("gamma", ABSENT if gamma is None else at_most(gamma, 6), "certified"),
        ("exact norm, nominal loop", figure("exact_norm", 5), "computed"),
        ("gain of the zero-state run", figure("gain", 5), _how_gain_was_measured(metrics)),
        ("final position error", figure("position_error_m", 3, "m"), "measured"),
        ("largest thrust", _text(thrust, 4, "N"), "measured"),
        ("time at a limit", _percent(number_in(metrics, "saturated_fraction")), "measured"),
        ("age that the design allows", figure("designed_age_s", 4, "s"), "certified up to this"),
        ("oldest measurement used", figure("message_age_s", 4, "s"), "measured"),
        *_measurement_ages(metrics),
        ("coupling delay", figure("coupling_delay_s", 4, "s"), "in addition to the links"),
        ("largest use of envelope", _percent(max(use.values(), default=None)), "measured"),
    ]


def _measurement_ages(metrics: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield a row for the greatest age of each measurement, and of the commands."""
    ages = metrics.get("measurement_ages")
    for name, age in ages.items() if isinstance(ages, Mapping) else ():
        if not isinstance(age, Mapping):
            continue
        measured = age.get("measured")
        most = number_in(measured, "greatest_s") if isinstance(measured, Mapping) else None
        bound = number_in(age, "greatest_s")
        how = f"measured; certified up to {bound:.4g} s" if bound else "measured; certified at once"
        yield f"oldest {name} used", _text(most, 4, "s"), how


def _how_gain_was_measured(metrics: Mapping[str, Any]) -> str:
    """Say how the gain was obtained; for a worst case, also its share of the exact norm."""
    worst, share = metrics.get("worst_case"), number_in(metrics, "norm_reached")
    omega = number_in(worst, "omega") if isinstance(worst, Mapping) else None
    if omega is None or share is None:
        return "measured"
    return f"measured: worst case at {omega:.4g} rad/s, {100 * share:.2f} % of the exact norm"


def _numbers(metrics: Mapping[str, Any], key: str) -> dict[str, float]:
    values = metrics.get(key)
    if not isinstance(values, Mapping):
        return {}
    return {n: v for n in values if (v := number_in(values, n)) is not None}


def _text(value: float | None, digits: int, unit: str = "") -> str:
    return ABSENT if value is None else f"{value:.{digits}g} {unit}".strip()


def _percent(value: float | None) -> str:
    if value is None:
        return ABSENT
    return f"{100 * value:.1f} %" if value < 1e3 else f"{100 * value:.3g} %"
