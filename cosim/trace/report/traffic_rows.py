"""Figures and charts of the links: messages delivered and dropped, delays, silences, ages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.trace.report.chart import Chart, Curve
from cosim.trace.report.link_record import LinkRecord
from cosim.trace.report.series import Reals, Recording


@dataclass(frozen=True)
class LinkFigures:
    """Figures of one link, measured from its messages in the trace.

    Attributes
    ----------
    sent, in_flight : as the run counted them; None if it did not finish.
    reasons : number of dropped messages, by reason.
    mean_delay_s, largest_delay_s : from sending to delivery [s]; None without deliveries.
    silence_s : longest time without a delivery [s].
    """

    name: str
    sent: int | None
    in_flight: int | None
    delivered: int
    reasons: dict[str, int]
    mean_delay_s: float | None
    largest_delay_s: float | None
    largest_age_s: float | None
    silence_s: float | None

    @property
    def dropped_share(self) -> float | None:
        """Dropped messages over those delivered or dropped; None without any."""
        dropped = sum(self.reasons.values())
        due = self.delivered + dropped
        return dropped / due if due else None


def figures(recording: Recording, counted: Mapping[str, Mapping[str, Any]]) -> list[LinkFigures]:
    """Return the figures of every link; `counted` are those in the run's result."""
    return [_figures(name, link, counted.get(name, {})) for name, link in recording.links.items()]


def _figures(name: str, link: LinkRecord, counted: Mapping[str, Any]) -> LinkFigures:
    sent, in_flight = (
        value if isinstance(value := counted.get(key), int) else None
        for key in ("sent", "in_flight")
    )
    reasons = dict(sorted(link.reasons.items()))
    if not link.delivered:
        return LinkFigures(name, sent, in_flight, 0, reasons, None, None, None, None)
    return LinkFigures(
        name,
        sent,
        in_flight,
        link.delivered,
        reasons,
        mean_delay_s=link.delay_ns / link.delivered / 1e9,
        largest_delay_s=link.largest_delay_ns / 1e9,
        largest_age_s=link.largest_age_ns / 1e9,
        silence_s=link.silence_ns / 1e9,
    )


def chart_of(recording: Recording, metrics: Mapping[str, Any]) -> Chart | None:
    """Chart the age of the message in use of each link, with dropped messages; None if no links."""
    links = recording.links
    if not links:
        return None
    chart = Chart("age", "Age of the message in use", "s", quantity="age")
    loop = _loop_age(recording, metrics.get("message_age_s"))
    if loop is not None:
        label = "measurement behind the command in force"
        chart.curves.append(Curve(label, *loop, role=0, unit="s"))
    for number, (name, link) in enumerate(links.items(), 1):
        t, age = link.ages()
        chart.curves.append(Curve(name, recording.seconds(t), age, role=number, unit="s"))
    most = max((float(np.nanmax(c.values, initial=0.0)) for c in chart.curves), default=0.0)
    for number, (name, link) in enumerate(links.items(), 1):
        if link.dropped:
            foot = -0.06 * most * number
            chart.curves.append(_marks(recording, name, link, number, foot))
    designed = metrics.get("designed_age_s")
    if isinstance(designed, int | float) and designed > 0 and loop is not None:
        chart.bounds = [("largest age of a measurement designed for", float(designed))]
    for name, age in (metrics.get("measurement_ages") or {}).items():
        bound = age.get("greatest_s")
        if name in links and isinstance(bound, int | float):
            chart.bounds.append((f"largest age of {name} designed for", float(bound)))
    return chart


def _loop_age(recording: Recording, known: Any) -> tuple[Reals, Reals] | None:
    """Return times and age [s] of the measurement behind the command in force (`loop_age`).

    None unless the greatest value is the one that the run measured: a controller with its own
    sampling instants has another age.
    """
    if not isinstance(known, int | float) or recording.loop is None:
        return None
    t, age = recording.loop.ages()
    if not abs(np.nanmax(age, initial=0.0) - known) <= 1e-6:
        return None
    return recording.seconds(t), age


def _marks(recording: Recording, name: str, link: LinkRecord, number: int, foot: float) -> Curve:
    """Mark each dropped message at the foot of the chart, in a row for each link."""
    due, sent, sequence = np.concatenate([heads for heads, _ in link.dropped], axis=1)
    reasons = [reason for _, words in link.dropped for reason in words]
    t, left = recording.seconds(due), recording.seconds(sent)
    text = [
        f"message {int(sequence[i])}, sent at {left[i]:.6g} s: {reasons[i]}"
        for i in range(due.size)
    ]
    return Curve(f"{name}: not used", t, np.full(t.size, foot), role=number, text=text)
