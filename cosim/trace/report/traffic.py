"""Figures and charts of the links: messages delivered and dropped, delays, silences, ages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.trace import Table
from cosim.trace.report.chart import Chart, Curve
from cosim.trace.report.series import Reals, Recording
from cosim.trace.traffic import loop_age


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
    end = _end(recording)
    return [
        _figures(name, recording, *tables, counted.get(name, {}), end)
        for name, tables in recording.links().items()
    ]


def _figures(
    name: str,
    recording: Recording,
    delivered: Table | None,
    dropped: Table | None,
    counted: Mapping[str, Any],
    end: float,
) -> LinkFigures:
    sent, in_flight = (
        value if isinstance(value := counted.get(key), int) else None
        for key in ("sent", "in_flight")
    )
    reasons = _reasons(dropped)
    if delivered is None or not len(delivered):
        return LinkFigures(name, sent, in_flight, 0, reasons, None, None, None, None)
    delays = (delivered.log_time_ns - delivered.publish_time_ns) / 1e9
    _, age = sawtooth(recording, delivered, end)
    arrived = np.sort(recording.seconds(delivered.log_time_ns))
    gaps = np.diff(np.append(arrived, max(end, float(arrived[-1]))))
    return LinkFigures(
        name,
        sent,
        in_flight,
        len(delivered),
        reasons,
        mean_delay_s=float(delays.mean()),
        largest_delay_s=float(delays.max()),
        largest_age_s=float(age.max()),
        silence_s=float(gaps.max()),
    )


def chart_of(recording: Recording, metrics: Mapping[str, Any], step_ns: int) -> Chart | None:
    """Chart the age of the message in use of each link, with dropped messages; None if no links."""
    links = recording.links()
    if not links:
        return None
    end = _end(recording)
    chart = Chart("age", "Age of the message in use", "s")
    loop = _loop_age(recording, step_ns, metrics.get("message_age_s"))
    if loop is not None:
        label = "measurement behind the command in force"
        chart.curves.append(Curve(label, *loop, role=0, unit="s"))
    for number, (name, (delivered, _)) in enumerate(links.items(), 1):
        t, age = sawtooth(recording, delivered, end)
        chart.curves.append(Curve(name, t, age, role=number, unit="s"))
    most = max((float(np.nanmax(c.values, initial=0.0)) for c in chart.curves), default=0.0)
    for number, (name, (_, dropped)) in enumerate(links.items(), 1):
        if dropped is not None and len(dropped):
            foot = -0.06 * most * number
            chart.curves.append(_marks(recording, name, dropped, number, foot))
    designed = metrics.get("designed_age_s")
    if isinstance(designed, int | float) and designed > 0 and loop is not None:
        chart.bounds = [("largest age of a measurement designed for", float(designed))]
    return chart


def sawtooth(recording: Recording, delivered: Table | None, end: float) -> tuple[Reals, Reals]:
    """Return times and age [s] of the last delivered message, up to the end of the run."""
    if delivered is None or not len(delivered):
        return np.zeros(0), np.zeros(0)
    order = np.argsort(delivered.log_time_ns, kind="stable")
    arrived = recording.seconds(delivered.log_time_ns[order])
    age = (delivered.log_time_ns - delivered.publish_time_ns)[order] / 1e9
    until = np.append(arrived[1:], max(end, float(arrived[-1])))
    t = np.column_stack([arrived, until]).ravel()
    return t, np.column_stack([age, age + until - arrived]).ravel()


def _loop_age(recording: Recording, step_ns: int, known: Any) -> tuple[Reals, Reals] | None:
    """Return times and age [s] of the measurement behind the command in force (`loop_age`).

    None unless the greatest value is the one that the run measured: a controller with its own
    sampling instants has another age.
    """
    if not isinstance(known, int | float) or not step_ns:
        return None
    tables = [table for table, _ in recording.links().values() if table is not None and len(table)]
    pairs = [(up, down) for up in tables for down in tables if _closes(recording, up, down)]
    if len(pairs) != 1:
        return None
    up, down = pairs[0]
    points = max(
        (t for t in recording.tables.values() if t.topic.endswith("/output")), key=len
    ).log_time_ns
    t, age = loop_age(up, down, points, step_ns)
    inside = (t >= points[0]) & (t <= points[-1])
    if not abs(np.nanmax(age[inside], initial=0.0) - known) <= 1e-6:
        return None
    return recording.seconds(t[inside]), age[inside]


def _closes(recording: Recording, up: Table, down: Table) -> bool:
    """Whether `up` comes from a plant and `down` from its controller, which has references."""
    plant, controller = ({name.partition(".")[0] for name in t.columns} for t in (up, down))
    if plant == controller or len(plant) != 1 or len(controller) != 1:
        return False
    inputs = (s for s in recording.series if s.direction == "input")
    return controller <= {s.component for s in inputs if s.name.startswith("reference.")}


def _marks(recording: Recording, link: str, dropped: Table, number: int, foot: float) -> Curve:
    """Mark each dropped message at the foot of the chart, in a row for each link."""
    reasons = dropped.columns.get("reason")
    t = recording.seconds(dropped.log_time_ns)
    sent = recording.seconds(dropped.publish_time_ns)
    text = [
        f"message {int(dropped.sequence[i])}, sent at {sent[i]:.6g} s: "
        f"{'dropped' if reasons is None else reasons[i]}"
        for i in range(len(dropped))
    ]
    return Curve(f"{link}: not used", t, np.full(t.size, foot), role=number, text=text)


def _reasons(dropped: Table | None) -> dict[str, int]:
    if dropped is None or not len(dropped):
        return {}
    column = dropped.columns.get("reason")
    if column is None:
        return {"dropped": len(dropped)}
    words, counts = np.unique(column.astype(str), return_counts=True)
    return {str(word): int(n) for word, n in zip(words, counts, strict=True)}


def _end(recording: Recording) -> float:
    ends = [float(recording.seconds(t.log_time_ns.max())) for t in recording.tables.values()]
    return max(ends, default=0.0)
