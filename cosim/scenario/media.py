"""[medium.NAME]: the media of a scenario, that links share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from cosim.core import Findings, InputError
from cosim.master import DelaySource, PositionSource
from cosim.network import SPEED_OF_SOUND, Medium, Node, RangeLogit, RangeTable
from cosim.scenario.fields import Length, Name, Part, Place, Probability, Speed
from cosim.scenario.link_keys import of_part, part_of
from cosim.scenario.matching import endpoint


class RangeTablePart(Part):
    """Probability of a loss by range: a table, on lines between its points, constant outside."""

    ranges: Annotated[list[Length], Field(min_length=1)]
    """Ranges; they increase."""
    losses: Annotated[list[Probability], Field(min_length=1)]
    """Probability of a loss at each of them."""

    @model_validator(mode="after")
    def _paired(self) -> Self:
        if len(self.ranges) != len(self.losses):
            raise ValueError(
                f"one probability for each range; got {len(self.ranges)} ranges and "
                f"{len(self.losses)} losses"
            )
        return self


_Logit: Any = part_of(RangeLogit)
_Medium: Any = part_of(
    Medium,
    speed=(Speed, SPEED_OF_SOUND),
    max_range=(Length, None),
    interference_range=(Length, None),
)


class RangeLogitPart(_Logit):  # type: ignore[misc]
    """Probability p of a loss by range: log(p / (1 - p)) = intercept + slope range."""


class MediumPart(_Medium):  # type: ignore[misc]
    """[medium.NAME]: nodes that hear each other, one packet at a time."""

    nodes: Annotated[dict[Name, Place], Field(min_length=2)]
    """Places of the nodes, by name: one to three coordinates, lengths or signals."""
    slots: list[Name] = Field(default_factory=list)
    """Nodes of the slots of a TDMA frame, in order."""
    loss: RangeTablePart | RangeLogitPart | None = None
    """Probability of a loss by range, of packets that nothing disturbed."""


def media_of(parts: Mapping[str, MediumPart], findings: Findings) -> dict[str, Medium]:
    """Make the media of a scenario; errors go to `findings`."""
    found = {}
    for name, part in parts.items():
        with findings.at("medium", name):
            found[name] = _medium_of(name, part)
    return found


def _medium_of(name: str, part: MediumPart) -> Medium:
    """Make a medium; the place of an error is a key of [medium.NAME]."""
    nodes = tuple(
        Node(node, tuple(None if isinstance(x, str) else x for x in place))
        for node, place in part.nodes.items()
    )
    try:
        loss: RangeTable | RangeLogit | None = None
        if isinstance(part.loss, RangeTablePart):
            loss = RangeTable(tuple(part.loss.ranges), tuple(part.loss.losses))
        elif part.loss is not None:
            loss = of_part(RangeLogit, part.loss)
        return of_part(Medium, part, name=name, nodes=nodes, slots=tuple(part.slots), loss=loss)
    except InputError as error:
        key = (error.where or "").removeprefix(f"medium {name!r}: ").removesuffix("_ns")
        error.where = f"medium.{name}.{key}"
        error.args = (error.text(),)
        raise


def position_sources(parts: Mapping[str, MediumPart]) -> dict[str, DelaySource | PositionSource]:
    """Return the signals that places of nodes follow, of each medium with such nodes."""
    signals = {
        f"medium.{name}": tuple(
            endpoint(x) for place in part.nodes.values() for x in place if isinstance(x, str)
        )
        for name, part in parts.items()
    }
    return {name: PositionSource(found) for name, found in signals.items() if found}
