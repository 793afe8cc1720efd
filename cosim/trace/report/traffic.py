"""What the links did: delivered and lost, delays, silences, and the age of what was in use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.trace import Table
from cosim.trace.report.chart import Chart, Curve
from cosim.trace.report.series import Reals, Recording


@dataclass(frozen=True)
class LinkFigures:
    """Figures of one link, measured from its messages in the trace.

    Attributes
    ----------
    sent, in_flight : as the run counted them; None if it did not finish.
    reasons : number of messages not used, by reason.
    mean_delay_s, largest_delay_s : from sending to delivery; None without deliveries.
    silence_s, silence_from_s : longest time without a delivery, and when it began.
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
    silence_from_s: float | None

    @property
    def dropped_share(self) -> float | None:
        """Share of the messages that were due and not used."""
        dropped = sum(self.reasons.values())
        due = self.delivered + dropped
        return dropped / due if due else None


def figures(recording: Recording, counted: Mapping[str, Mapping[str, str]]) -> list[LinkFigures]:
    """Figures of every link; `counted` are those of the run's result."""
    end = _end(recording)
    found = []
    for name, (delivered, dropped) in recording.links().items():
        recorded = counted.get(name, {})
        delays = _delays(delivered)
        _, age = sawtooth(recording, delivered, end)
        silence = _silence(recording, delivered, end)
        found.append(
            LinkFigures(
                name,
                _count(recorded.get("sent")),
                _count(recorded.get("in_flight")),
                0 if delivered is None else len(delivered),
                _reasons(dropped),
                float(delays.mean()) if delays.size else None,
                float(delays.max()) if delays.size else None,
                float(age.max()) if age.size else None,
                *silence,
            )
        )
    return found


def chart_of(recording: Recording, metrics: Mapping[str, Any], step_ns: int) -> Chart | None:
    """Age of the message in use, link by link, with what was lost; None without links."""
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
    """Times and age of the message that was delivered last, up to the end of the run."""
    if delivered is None or not len(delivered):
        return np.zeros(0), np.zeros(0)
    order = np.argsort(delivered.log_time_ns, kind="stable")
    arrived = recording.seconds(delivered.log_time_ns[order])
    age = (delivered.log_time_ns - delivered.publish_time_ns)[order] / 1e9
    until = np.append(arrived[1:], max(end, float(arrived[-1])))
    t = np.column_stack([arrived, until]).ravel()
    return t, np.column_stack([age, age + until - arrived]).ravel()


def _loop_age(recording: Recording, step_ns: int, known: Any) -> tuple[Reals, Reals] | None:
    """Age of the measurement behind the command in force, round the loop of two links.

    Back from the command's own message to the measurement that had reached the controller one
    step before it was sent. Drawn only where its greatest value is the one that the run
    measured: a controller that waits for its own sampling instants has another.
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
    arrivals = down.log_time_ns
    t = np.unique(np.concatenate([points, arrivals, arrivals - 1]))
    t = t[(t >= points[0]) & (t <= points[-1])]
    command = np.searchsorted(arrivals, t, side="right") - 1
    sent = down.publish_time_ns[np.maximum(command, 0)]
    measured = np.searchsorted(up.log_time_ns, sent - step_ns, side="right") - 1
    age = (t - up.publish_time_ns[np.maximum(measured, 0)]) / 1e9
    age = np.where((command >= 0) & (measured >= 0), age, np.nan)
    if not abs(np.nanmax(age, initial=0.0) - known) <= 1e-6:
        return None
    return recording.seconds(t), age


def _closes(recording: Recording, up: Table, down: Table) -> bool:
    """Whether `up` goes to the component that `down` comes from, and back."""
    plant, controller = _sources(up), _sources(down)
    if plant == controller or len(plant) != 1 or len(controller) != 1:
        return False
    references = [
        s.component
        for s in recording.series
        if s.direction == "input" and s.name.startswith("reference.")
    ]
    return controller <= set(references)


def _sources(table: Table) -> set[str]:
    return {name.partition(".")[0] for name in table.columns}


def _marks(recording: Recording, link: str, dropped: Table, number: int, foot: float) -> Curve:
    """One mark at the foot of the chart per message that was not used, a row for each link."""
    reasons = dropped.columns.get("reason")
    t = recording.seconds(dropped.log_time_ns)
    sent = recording.seconds(dropped.publish_time_ns)
    text = [
        f"message {int(dropped.sequence[i])}, sent at {sent[i]:.6g} s: "
        f"{'dropped' if reasons is None else reasons[i]}"
        for i in range(len(dropped))
    ]
    return Curve(f"{link}: not used", t, np.full(t.size, foot), role=number, text=text)


def _delays(delivered: Table | None) -> Reals:
    if delivered is None:
        return np.zeros(0)
    return (delivered.log_time_ns - delivered.publish_time_ns) / 1e9


def _silence(
    recording: Recording, delivered: Table | None, end: float
) -> tuple[float | None, float | None]:
    if delivered is None or not len(delivered):
        return None, None
    arrived = np.sort(recording.seconds(delivered.log_time_ns))
    gaps = np.diff(np.append(arrived, max(end, float(arrived[-1]))))
    longest = int(np.argmax(gaps))
    return float(gaps[longest]), float(arrived[longest])


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


def _count(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() else None


def moments(link: LinkFigures) -> Iterator[tuple[float, str]]:
    """What is worth knowing of a link, and when it was."""
    if link.silence_s is not None and link.silence_from_s is not None and link.reasons:
        yield (
            link.silence_from_s,
            f"{link.name}: longest silence, {link.silence_s:.4g} s without a delivery",
        )
