"""Collect the content of a page of two traces: outcomes, figures and signals side by side."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.trace.comparison.compared_rows import SignalDiff
from cosim.trace.comparison.signals import Diff, diff
from cosim.trace.outcome.verdict import Statement
from cosim.trace.report.chart import Chart, Curve, curve_of
from cosim.trace.report.generic import is_constant
from cosim.trace.report.link_record import Points
from cosim.trace.report.page_content import Content, content_of
from cosim.trace.report.series import DrawnSeries, Reals
from cosim.trace.report.traffic_rows import LinkFigures
from cosim.trace.rows.layout import signal_name
from cosim.trace.traces import leaves

MAX_SIGNALS = 24
"""Most signals of which both curves, and their difference, are drawn."""
_COPIES = ("input", "link")
_SEGMENTS = 3000
_BEHIND = "measurement behind the command in force"

_Key = tuple[str, str]


@dataclass(frozen=True)
class Ratio:
    """A figure of both runs, None where one has none; `ratio` is second over first."""

    name: str
    a: float | None
    b: float | None

    @property
    def ratio(self) -> float | None:
        """Second over first; None where there is no such number."""
        if self.a is None or self.b is None or self.a == 0.0:
            return None
        return self.b / self.a


@dataclass(frozen=True)
class Comparison:
    """The content of a page of two traces; pairs belong to the first trace and the second.

    Attributes
    ----------
    names : of the files; their paths where the names are equal.
    bars : label and origin of gain, norm and bound; of each run the value, None without one, and
        its share of the greatest of all.
    metrics : the figures of the outcomes.
    assertions, assumptions : by their words.
    parted : signals that differ, those drawn first.
    apart : of each signal drawn, both curves and second minus first.
    alike : charts of outputs that do not differ.
    links : the figures of every link of both.
    age : the age of the measurements of both; None without loops.
    """

    a: Content
    b: Content
    names: tuple[str, str]
    found: Diff
    bars: list[tuple[str, str, list[tuple[float | None, float]]]]
    metrics: list[Ratio]
    assertions: list[tuple[str, Statement | None, Statement | None]]
    assumptions: list[tuple[str, Statement | None, Statement | None]]
    parted: list[SignalDiff]
    apart: list[tuple[Chart, Chart]]
    alike: list[Chart]
    links: list[LinkFigures]
    age: Chart | None

    @property
    def charts(self) -> list[Chart]:
        """All charts."""
        ages = [] if self.age is None else [self.age]
        return [*(chart for pair in self.apart for chart in pair), *ages, *self.alike]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time shown [s]."""
        return min(self.a.span[0], self.b.span[0]), max(self.a.span[1], self.b.span[1])


def comparison_of(a: Path, b: Path) -> Comparison:
    """Read two traces, and what differs between them, part by part.

    Raises
    ------
    InputError : a file is no trace.
    LossError : a trace is damaged.
    """
    differences: dict[_Key, Points] = {}
    first, second = content_of(a), content_of(b)
    length = max(first.span[1] - first.span[0], second.span[1] - second.span[0])

    def seen(topic: str, name: str, instants: NDArray[np.int64], values: Reals) -> None:
        if instants.size:
            share = float(instants[-1] - instants[0]) / max(length * 1e9, 1.0)
            segments = 1 + int(_SEGMENTS * min(share, 1.0))
            differences.setdefault((topic, name), Points()).add(instants, values, segments)

    found = diff(a, b, seen=seen)
    names = (a.name, b.name) if a.name != b.name else (str(a), str(b))
    mine, theirs = _by_key(first), _by_key(second)
    parted = sorted(found.parted, key=_outputs_first)
    differing = {(signal.topic, signal.name) for signal in parted}
    both = [key for key in mine if key in theirs]
    drawable = [s for s in parted if (s.topic, s.name) in both]
    # inputs and links repeat the outputs, up to delays
    chosen = [s for s in drawable if mine[s.topic, s.name].direction not in _COPIES] or drawable
    same = [
        key
        for key in both
        if key not in differing
        and mine[key].direction not in _COPIES
        and not is_constant(mine[key])
    ]
    return Comparison(
        a=first,
        b=second,
        names=names,
        found=found,
        bars=_bars(first, second),
        metrics=list(_ratios(first, second)),
        assertions=_side_by_side(first.assertions, second.assertions),
        assumptions=_side_by_side(first.assumptions, second.assumptions),
        parted=parted,
        apart=[
            _pair(number, signal, mine[key], theirs[key], _difference(first, differences[key]))
            for number, signal in enumerate(chosen[:MAX_SIGNALS])
            for key in [(signal.topic, signal.name)]
        ],
        alike=[
            Chart(f"alike-{k}", key[1], mine[key].unit or "", _alike(mine[key], theirs[key]))
            for k, key in enumerate(same[:MAX_SIGNALS])
        ],
        links=[
            replace(link, name=f"{link.name}, {word}")
            for name in dict.fromkeys(link.name for one in (first, second) for link in one.links)
            for word, one in (("first", first), ("second", second))
            for link in one.links
            if link.name == name
        ],
        age=_age(first, second),
    )


def _by_key(content: Content) -> dict[_Key, DrawnSeries]:
    """Return the signals by topic, and the name that a comparison uses."""
    return {(s.topic, signal_name(s.topic, s.name)): s for s in content.series}


def _outputs_first(signal: SignalDiff) -> tuple[bool, float]:
    """Sort outputs of components before their copies on links, and large differences first."""
    most = np.inf if signal.max_rel is None else signal.max_rel
    return not signal.topic.endswith("/output"), -most


def _difference(content: Content, line: Points) -> tuple[Reals, Reals]:
    t_ns, values = line.points()
    return (t_ns - content.origin_ns) / 1e9, values


def _pair(
    number: int, signal: SignalDiff, a: DrawnSeries, b: DrawnSeries, difference: tuple[Reals, Reals]
) -> tuple[Chart, Chart]:
    """Chart both curves of a signal, and their difference."""
    unit = a.unit or b.unit or ""
    curves = [curve_of(a, 0, "first"), curve_of(b, 1, "second")]
    apart = Curve(
        "second minus first",
        *difference,
        stepwise=a.stepwise or signal.sample_and_hold,
        role=2,
        unit=unit,
    )
    return (
        Chart(f"both-{number}", signal.name, unit, curves),
        Chart(
            f"apart-{number}",
            f"{signal.name}, second minus first",
            unit,
            [apart],
            quantity="difference",
        ),
    )


def _alike(a: DrawnSeries, b: DrawnSeries) -> list[Curve]:
    """Draw one curve for both, and two where one ends before the other."""
    if a.t[-1] == b.t[-1]:
        return [curve_of(a, 0, "both")]
    return [curve_of(b, 1, "second"), curve_of(a, 0, "first")]


def _bars(a: Content, b: Content) -> list[tuple[str, str, list[tuple[float | None, float]]]]:
    values = [{label: value for label, value, _, _ in one.bars} for one in (a, b)]
    origins = {label: how for one in (a, b) for label, _, _, how in one.bars}
    most = max((value for one in values for value in one.values()), default=0.0)
    return [
        (
            label,
            how,
            [
                (value, value / most if value is not None and most > 0 else 0.0)
                for value in (one.get(label) for one in values)
            ],
        )
        for label, how in origins.items()
    ]


def _ratios(a: Content, b: Content) -> Iterator[Ratio]:
    figures = [
        {
            name: float(value)
            for name, value in leaves(one.outcome.metrics)
            if isinstance(value, int | float) and not isinstance(value, bool)
        }
        for one in (a, b)
    ]
    for name in dict.fromkeys([*figures[0], *figures[1]]):
        if any(one.get(name) for one in figures):  # what is zero in both tells nothing
            yield Ratio(name, figures[0].get(name), figures[1].get(name))


def _side_by_side(
    a: list[Statement], b: list[Statement]
) -> list[tuple[str, Statement | None, Statement | None]]:
    """Put the statements of both runs side by side, by their words."""
    one, two = ({check.what: check for check in checks} for checks in (a, b))
    return [(what, one.get(what), two.get(what)) for what in dict.fromkeys([*one, *two])]


def _age(a: Content, b: Content) -> Chart | None:
    curves = [
        replace(curve, label=label, role=role)
        for role, (label, content) in enumerate((("first", a), ("second", b)))
        for chart in content.charts
        for curve in chart.curves
        if curve.label == _BEHIND
    ]
    title = "Age of the measurement behind the command in force"
    return Chart("age", title, "s", curves, quantity="age") if curves else None
