"""The values of the axes in every run, as a function of the study and the run's number alone.

Grid axes count like the digits of a number, the first one slowest; then come the drawn points;
replicates are fastest. Every point of the grid has the same drawn points, so that two points of
the grid differ only by the values of the grid axes.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.study.sampling import draw
from cosim.study.schema import MAX_RUNS, Axis, GridAxis, ReplicatesAxis, SampledAxis, Study


class Points:
    """The values of all axes in every run; `where` is the place in messages.

    Attributes
    ----------
    axes : the axes in the order of the study.
    count : number of runs.

    Raises
    ------
    InputError : too many runs, or as `sampling.draw`.
    """

    def __init__(self, study: Study, where: str = "vary") -> None:
        self.axes: tuple[Axis, ...] = tuple(study.vary)
        sampled: list[Any] = [a for a in study.vary if isinstance(a, SampledAxis)]
        self._values: dict[int, Any] = dict(
            zip(map(id, sampled), draw(sampled, study), strict=True)
        )
        grids: list[list[Axis]] = []
        replicates: list[list[Axis]] = []
        for axis in study.vary:
            if isinstance(axis, GridAxis):
                self._values[id(axis)] = _grid_values(axis)
                grids.insert(0, [axis])
            elif isinstance(axis, ReplicatesAxis):
                self._values[id(axis)] = range(axis.first, axis.first + axis.count)
                replicates.insert(0, [axis])
        self._strides: dict[int, int] = {}
        self.count = 1
        for together in (*replicates, *([sampled] if sampled else []), *grids):  # fastest first
            self._strides |= {id(axis): self.count for axis in together}
            self.count *= len(self._values[id(together[0])])
        if self.count > MAX_RUNS:
            raise InputError(
                "too many runs",
                where=where,
                expected=f"at most {MAX_RUNS}",
                got=f"{self.count}: the product of the axes",
            )

    @property
    def most(self) -> int:
        """Number of runs that there may be at the end."""
        return self.count

    def __getitem__(self, run: int) -> tuple[Any, ...]:
        """Return the value of every axis in run number `run`, counted from 0."""
        return tuple(self._value(axis, run) for axis in self.axes)

    def types(self) -> list[set[type]]:
        """Return the types of the values of each axis."""
        every = (self._values[id(axis)] for axis in self.axes)
        return [
            {type(v[0].item())} if isinstance(v, np.ndarray) else set(map(type, v)) for v in every
        ]

    def extended(self, run: int, more: Points) -> int:
        """Return the number of a run in a study that has more samples and is the same else."""
        sampled = next(axis for axis in self.axes if isinstance(axis, SampledAxis))
        stride, count = self._strides[id(sampled)], len(self._values[id(sampled)])
        mine = next(axis for axis in more.axes if isinstance(axis, SampledAxis))
        outer, inner = divmod(run, stride * count)
        return outer * stride * len(more._values[id(mine)]) + inner

    def draws(self, runs: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """Return the number of the draw that each run belongs to, counted from 0, (n,).

        Draws are the samples, or the replicates where there is one sample or none; None without.
        """
        sampled = [axis for axis in self.axes if isinstance(axis, SampledAxis)]
        if sampled and (count := len(self._values[id(sampled[0])])) > 1:
            together = len(sampled) + 2 if sampled[0].kind == "saltelli" else 1
            return runs // self._strides[id(sampled[0])] % count // together
        seeds = math.prod(
            len(self._values[id(axis)]) for axis in self.axes if isinstance(axis, ReplicatesAxis)
        )
        return runs % seeds if seeds > 1 else None

    def _value(self, axis: Axis, run: int) -> Any:
        values = self._values[id(axis)]
        value = values[run // self._strides[id(axis)] % len(values)]
        return value.item() if isinstance(value, np.generic) else value


def _grid_values(axis: GridAxis) -> list[Any]:
    if axis.values is not None:
        return list(axis.values)
    if axis.rows is not None:
        return [list(row) for row in axis.rows]
    first, last, count = axis.linspace or axis.logspace or (0.0, 0.0, 0)
    spaced = np.linspace if axis.linspace else np.geomspace
    # 0.1, not 0.09999999999999999: tables are grouped by these values
    return [float(f"{x:.12g}") for x in spaced(first, last, int(count))]
