"""Routes from senders to receivers: which columns are read, and over what.

An input is constant during a step of its receiver. The policy says at which value:

* hold: the signal, delayed by its link, at the beginning of the step (order 1);
* midpoint: the delayed signal in the middle of the step, which must be known: over a transport
  link with a delay of at least half a step (order 2);
* linear: the same, extrapolated from past values where it is not known (order 2);
* previous: what hold reads at the communication point before, one step of delay more. At the
  first point it is the value that the initialisation settled on.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cosim.master.parts import Policy, RouteKey
from cosim.master.rows_in_use import RowsInUse
from cosim.network import PacketLink

LOOKING_AHEAD: tuple[Policy, ...] = ("midpoint", "linear")
"""Policies whose value is not that at the beginning of the step."""


@dataclass(frozen=True, eq=False)
class Route:
    """Inputs of one component that read outputs of one other over the same link and policy.

    Attributes
    ----------
    route_key : sender, link and policy.
    columns, targets : columns of the rows that are read and written.
    in_step : the rows read for the step from each point.
    at_point : those read for the outputs of the point itself, where they are others: the receiver
        has direct feedthrough, and its policy looks ahead.
    initialised : as in `RowsInUse`.
    """

    route_key: RouteKey
    columns: NDArray[np.intp]
    targets: NDArray[np.intp]
    in_step: RowsInUse
    at_point: RowsInUse | None = None

    @property
    def link(self) -> PacketLink | None:
        """The packet link, or None."""
        link = self.in_step.link
        return link if isinstance(link, PacketLink) else None

    @property
    def link_alters(self) -> bool:
        """Whether the packet link rounds values, or has a substitute for them."""
        link = self.link
        return link is not None and bool(link.quantization or link.substitute is not None)

    @property
    def samples(self) -> tuple[RowsInUse, ...]:
        """The rows read for the steps, and for the points where they are others."""
        return (self.in_step,) if self.at_point is None else (self.in_step, self.at_point)

    @property
    def initialised(self) -> bool:
        """As in `RowsInUse`."""
        return self.samples[-1].initialised

    @property
    def at_start(self) -> bool:
        """Whether the inputs have a value of the sender at the first point."""
        return self.initialised or bool(self.in_step.row[0] >= 0)

    @property
    def source(self) -> str:
        """Name of the sender."""
        return self.route_key.source

    @cached_property
    def spans(self) -> tuple[slice, slice] | None:
        """The columns read and written as slices, where both are neighbours; else None."""
        pairs = np.column_stack([self.columns, self.targets])
        if not (np.diff(pairs, axis=0) == 1).all():
            return None
        (source, target), count = pairs[0].tolist(), len(pairs)
        return slice(source, source + count), slice(target, target + count)

    @cached_property
    def unaltered(self) -> bool:
        """Whether its values are those of the sender, each of one row."""
        return self.in_step.weight is None and not self.link_alters

    @cached_property
    def verbatim(self) -> bool:
        """Whether its values are neighbours, in the sender's row and the receiver's, unaltered."""
        return self.unaltered and self.spans is not None


def merged_routes(routes: Iterable[Route]) -> list[Route]:
    """Return routes to one component, one for all that read the same rows at every time.

    The columns of one that stands for several are in the order of what it writes.
    """
    by_samples: dict[tuple[RowsInUse, ...], list[Route]] = {}
    for route in routes:
        by_samples.setdefault(route.samples, []).append(route)
    return [
        members[0] if len(members) == 1 else _as_one(members) for members in by_samples.values()
    ]


def _as_one(routes: Sequence[Route]) -> Route:
    targets = np.concatenate([route.targets for route in routes])
    order = np.argsort(targets)
    columns = np.concatenate([route.columns for route in routes])[order]
    return replace(routes[0], columns=columns, targets=targets[order])
