"""The values of the axes in every run, as a function of the study and the run's number alone.

Grid axes count like the digits of a number, the first one slowest; then come the drawn points;
replicates are fastest. Every point of the grid has the same drawn points, so that two points of
the grid differ only by the values of the grid axes.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from cosim.core import InputError
from cosim.study.schema import MAX_RUNS, Axis, GridAxis, ReplicatesAxis, SampledAxis, Study


class Points:
    """The values of all axes in every run; `where` is the place in messages.

    Attributes
    ----------
    axes : the axes in the order of the study.
    count : number of runs.

    Raises
    ------
    InputError : too many runs or too many Sobol axes.
    """

    def __init__(self, study: Study, where: str = "vary") -> None:
        self.axes: tuple[Axis, ...] = tuple(study.vary)
        sampled: list[Any] = [a for a in study.vary if isinstance(a, SampledAxis)]
        self._values: dict[int, Any] = dict(
            zip(map(id, sampled), _draw(sampled, study), strict=True)
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

    def __getitem__(self, run: int) -> tuple[Any, ...]:
        """Return the value of every axis in run number `run`, counted from 0."""
        return tuple(self._value(axis, run) for axis in self.axes)

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


def _draw(axes: list[SampledAxis], study: Study) -> list[Any]:
    """Return the `samples` values of each axis."""
    count = sum(axis.kind == "sobol" for axis in axes)
    columns: Iterator[NDArray[np.float64]] = iter(_sobol(count, study).T if count else ())
    result: list[Any] = []
    for place, axis in enumerate(axes):
        if axis.kind == "sobol":
            shares = np.ascontiguousarray(next(columns))
        else:
            # a stream of its own per axis: adding or removing another axis changes no draws
            shares = np.random.default_rng([study.seed, place]).random(study.samples)
        result.append(_distributed(axis, shares))
    return result


def _sobol(dimensions: int, study: Study) -> NDArray[np.float64]:
    """Return points of a scrambled Sobol sequence, (samples, dimensions)."""
    from scipy.stats import qmc  # noqa: PLC0415 - loading it takes half a second

    if dimensions > qmc.Sobol.MAXDIM:
        raise InputError(
            "too many sobol axes",
            where="vary",
            expected=f"at most {qmc.Sobol.MAXDIM}",
            got=str(dimensions),
        )
    sequence = qmc.Sobol(dimensions, scramble=True, rng=np.random.default_rng(study.seed))
    with warnings.catch_warnings():
        # a count that is not a power of two is less balanced but valid: the user's choice
        warnings.filterwarnings("ignore", "The balance properties", UserWarning)
        drawn: NDArray[np.float64] = sequence.random(study.samples)
    return drawn


def _distributed(axis: SampledAxis, u: NDArray[np.float64]) -> Any:
    """Map numbers in [0, 1) to values of the axis, by the inverse of its distribution."""
    if axis.uniform is not None:
        low, high = axis.uniform
        return low + (high - low) * u
    if axis.loguniform is not None:
        low, high = (math.log(x) for x in axis.loguniform)
        return np.exp(low + (high - low) * u)
    if axis.normal is not None:
        mean, sigma = axis.normal
        tiny = 2.0**-53  # 0 means the first of 2**53 steps, not minus infinity
        return mean + sigma * ndtri(np.maximum(u, tiny))
    if axis.integers is not None:
        first, last = axis.integers
        return first + np.floor(u * (last - first + 1)).astype(np.int64)
    choice = axis.choice or []
    return [choice[i] for i in np.floor(u * len(choice)).astype(int)]
