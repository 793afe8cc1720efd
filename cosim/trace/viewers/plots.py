"""Choose what to plot of a trace: signals of one group and unit together, a tab per component."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from cosim.trace.rows.layout import (
    LINK_STATE_SIGNALS,
    LOG_TOPIC,
    Signal,
    component_of,
    link_state_topic,
    link_topic,
    output_topic,
)
from cosim.trace.tables.topic_info import TopicInfo

MOST_CURVES, MOST_PLOTS, MOST_TABS = 12, 8, 16
"""Most curves in a plot, plots in a tab, and tabs: thousands of curves show nothing."""

_PLACE, _REFERENCE = "eta", "reference"


@dataclass(frozen=True, slots=True)
class PlotSignal:
    """One signal of a plot.

    Attributes
    ----------
    field : names of the protobuf fields that lead to it, joined by dots.
    label : name and unit, for people.
    """

    topic: str
    field: str
    label: str
    unit: str | None
    continuous: bool


@dataclass(frozen=True, slots=True)
class Plot:
    """Curves of one unit."""

    title: str
    unit: str | None
    curves: list[PlotSignal]


@dataclass(slots=True)
class Tab:
    """Plots below each other."""

    title: str
    plots: list[Plot] = field(default_factory=list)


def tabs_of(topics: dict[str, TopicInfo]) -> tuple[list[Tab], int]:
    """Return the tabs for a trace, and how many curves there was no room for.

    Outputs of components, with the reference beside the place it is for; ages and counts of links;
    and the signals of other tools' topics.
    """
    tabs = [tab for tab in (*_components(topics), *_links(topics), *_others(topics)) if tab.plots]
    kept = [
        Tab(tab.title, [_cut(plot) for plot in tab.plots[:MOST_PLOTS]]) for tab in tabs[:MOST_TABS]
    ]
    return kept, _count(tabs) - _count(kept)


def _cut(plot: Plot) -> Plot:
    return Plot(plot.title, plot.unit, plot.curves[:MOST_CURVES])


def _count(tabs: list[Tab]) -> int:
    return sum(len(plot.curves) for tab in tabs for plot in tab.plots)


def _components(topics: dict[str, TopicInfo]) -> Iterator[Tab]:
    references = [
        curve
        for topic, info in topics.items()
        if component_of(topic) and topic != output_topic(str(component_of(topic)))
        for curve in _curves(info, {_REFERENCE})
    ]
    for topic, info in topics.items():
        component = component_of(topic)
        if component is None or topic != output_topic(component):
            continue
        tab = Tab(component)
        for group in dict.fromkeys(_group(signal.name) for signal in info.signals):
            more = references if group == _PLACE else []
            tab.plots += _plots(f"{component}: {group}", [*_curves(info, {group}), *more])
        yield tab


def _links(topics: dict[str, TopicInfo]) -> Iterator[Tab]:
    """Yield one tab of all links: each of their figures together."""
    prefix = link_topic("")
    names = [t.removeprefix(prefix).removesuffix("/state") for t in topics if t.startswith(prefix)]
    states = [n for n in dict.fromkeys(names) if link_state_topic(n) in topics]
    tab = Tab("links")
    for signal in LINK_STATE_SIGNALS:
        curves = [
            curve
            for name in states
            for curve in _curves(topics[link_state_topic(name)], None)
            if curve.field == signal.name
        ]
        if curves:
            tab.plots.append(Plot(f"links: {signal.name}", signal.unit, curves))
    yield tab


def _others(topics: dict[str, TopicInfo]) -> Iterator[Tab]:
    for topic, info in topics.items():
        ours = component_of(topic) or info.is_computed or topic.startswith(link_topic(""))
        if not ours and topic != LOG_TOPIC and not info.schema.startswith("foxglove."):
            yield Tab(topic, list(_plots(topic, _curves(info, None))))


def _plots(title: str, curves: list[PlotSignal]) -> Iterator[Plot]:
    for unit in dict.fromkeys(curve.unit for curve in curves):
        yield Plot(title, unit, [curve for curve in curves if curve.unit == unit])


def _curves(info: TopicInfo, groups: set[str] | None) -> list[PlotSignal]:
    """Return the curves of the numbers of a topic: of some groups, or of all."""
    if info.encoding != "protobuf" or not info.count:
        return []
    fields = {
        name: key.removesuffix(".name")
        for key, name in info.metadata.items()
        if key.endswith(".name")
    }
    return [
        PlotSignal(
            info.topic,
            fields.get(signal.name, signal.name),
            _label(info.topic, signal),
            signal.unit,
            signal.hold == "continuous",
        )
        for signal in info.signals
        if signal.kind != "string" and (groups is None or _group(signal.name) in groups)
    ]


def _group(name: str) -> str:
    """Return the group of a signal: `eta` of `eta.x`, `K` of `K[1,3]`; its name without one."""
    return re.split(r"[.\[]", name, maxsplit=1)[0]


def _label(topic: str, signal: Signal) -> str:
    owner = component_of(topic) or topic.removeprefix(link_topic("")).removesuffix("/state")
    return f"{owner} {signal.name}" + (f" [{signal.unit}]" if signal.unit else "")
