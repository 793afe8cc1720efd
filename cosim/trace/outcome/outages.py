"""What a run says of the proof across outages, in words, from the metric `outages`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from cosim.trace.outcome.run_outcome import BAD, GOOD, OPEN

_MOST_TIMES = 6


def outage_rows(found: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield the label, the value, and how it was obtained; `found` : the metric."""
    needed, had = found["share_needed"], found["share_had"]
    alpha, beta = found["alpha"], found["beta"]
    yield "link up, needed", _percent(needed), f"certified: alpha {alpha:g}, beta {beta:g}"
    outages = f"measured; longest outage {found['longest_outage_s']:.4g} s"
    yield "link up, had", _percent(had), outages
    if found["uncovered_at_s"] is not None:
        lasted = f"{found['uncovered_s']:.4g} s"
        why = f"from {found['uncovered_at_s']:.6g} s on a value older than designed for was held"
        yield "time that no proof covers", lasted, why
        return
    share = _percent(found["guaranteed_share"])
    yield "time in which gamma was held", share, _suspensions(found)
    growth = f"at most {_power(found['greatest_exponent'])} times"
    how = f"certified for w = 0, over this run's outages; {_power(found['exponent'])} at the end"
    yield "V from any time to any later one", growth, how
    ratio = found["value_ratio"]
    if ratio is not None:
        yield "largest V / its bound", f"{ratio:.4g}", "computed along the run"
    if found["weighted_gain"] is not None:
        gamma = f"zero-state run; certified: at most {found['gamma']:.5g}"
        yield "gain, weighted across outages", f"{found['weighted_gain']:.5g}", gamma
    if found["plain_gain_bound"] is not None:
        how = "certified, over this run's outages, without weights"
        yield "bound of the gain", f"{found['plain_gain_bound']:.5g}", how


def outage_verdict(found: Mapping[str, Any]) -> tuple[str, str, str]:
    """Return the tone, the words, and the numbers of what holds in place of gamma."""
    if found["uncovered_at_s"] is not None:
        since = f"from {found['uncovered_at_s']:.6g} s on"
        why = "the plant held a value older than designed for, which no proof covers"
        return BAD, "The guarantee is not claimed", f"{since} {why}"
    if found["value_within_bound"] is False or found["weighted_gain_within_gamma"] is False:
        return (
            BAD,
            "The run left the bounds across outages",
            "although every interval was covered: is the plant the one designed for?",
        )
    had, needed = found["share_had"], found["share_needed"]
    enough = f"link up {_percent(had)} of the time, {_percent(needed)} needed"
    if had <= needed:
        words = "The bound gamma was suspended by outages, and V need not fall"
        return OPEN, words, f"{enough}; V at most {_power(found['exponent'])} V(0)"
    if found["suspensions"] == 0:
        return GOOD, "The guarantee holds for this run", f"{enough}; never suspended"
    return (
        OPEN,
        "The bound gamma was suspended by outages; the bounds across them hold",
        f"{enough}; {_suspensions(found)}",
    )


def _suspensions(found: Mapping[str, Any]) -> str:
    """Say when the guarantee was suspended and regained."""
    times, count = found["suspensions_s"], found["suspensions"]
    if not count:
        return "never suspended"
    texts = [
        f"{begin:.6g} s to {'the end' if end is None else f'{end:.6g} s'}"
        for begin, end in times[:_MOST_TIMES]
    ]
    more = f" and {count - len(texts)} more" if count > len(texts) else ""
    return f"suspended from {', '.join(texts)}{more}"


def _percent(value: float) -> str:
    return f"{100 * value:.4g} %"


def _power(exponent: float) -> str:
    return f"{math.exp(exponent):.3g}" if abs(exponent) < 300 else f"e^{exponent:.4g}"
