"""Which values every run of a study has: a pure function of the study and the run's number.

Grid axes count like the digits of a number, the first one slowest; then the drawn points; then
the replicates, fastest. The same drawn points meet every point of the grid, so that two cells
differ by what the grid moved and by nothing else.
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
from cosim.study.schema import (
    MAX_RUNS,
    Axis,
    GridAxis,
    ReplicatesAxis,
    SampledAxis,
    Study,
)


class Points:
    """The values of all axes in every run; `where` stands in messages.

    Attributes
    ----------
    axes : as in the study.
    count : number of runs.

    Raises
    ------
    InputError : more runs, or more Sobol axes, than can be had.
    """

    def __init__(self, study: Study, where: str = "vary") -> None:
        self.axes: tuple[Axis, ...] = tuple(study.vary)
        sampled = [a for a in study.vary if isinstance(a, SampledAxis)]
        self._drawn = dict(zip(map(id, sampled), _draw(sampled, study), strict=True))
        self._sizes: dict[int, int] = {}
        slow = [a for a in study.vary if isinstance(a, GridAxis)]
        fast = [a for a in study.vary if isinstance(a, ReplicatesAxis)]
        self._strides: dict[int, int] = {}
        stride = 1
        for seeds in reversed(fast):
            self._strides[id(seeds)], self._sizes[id(seeds)] = stride, seeds.count
            stride *= seeds.count
        for drawn in sampled:
            self._strides[id(drawn)], self._sizes[id(drawn)] = stride, study.samples
        stride *= study.samples if sampled else 1
        self._values = {id(grid): _values(grid) for grid in slow}
        for grid in reversed(slow):
            size = len(self._values[id(grid)])
            self._strides[id(grid)], self._sizes[id(grid)] = stride, size
            stride *= size
        self.count = stride
        if self.count > MAX_RUNS:
            raise InputError(
                "too many runs",
                where=where,
                expected=f"at most {MAX_RUNS}",
                got=f"{self.count}: the product of the axes",
            )

    def __getitem__(self, run: int) -> tuple[Any, ...]:
        """The value of every axis in run number `run`, from 0."""
        return tuple(self._value(axis, run) for axis in self.axes)

    def _value(self, axis: Axis, run: int) -> Any:
        place = run // self._strides[id(axis)] % self._sizes[id(axis)]
        if isinstance(axis, ReplicatesAxis):
            return axis.first + place
        if isinstance(axis, GridAxis):
            return self._values[id(axis)][place]
        return _plain(self._drawn[id(axis)][place])


def _values(axis: GridAxis) -> list[Any]:
    if axis.values is not None:
        return list(axis.values)
    if axis.rows is not None:
        return [list(row) for row in axis.rows]
    first, last, count = axis.linspace or axis.logspace or (0.0, 0.0, 0)
    spaced = np.linspace if axis.linspace else np.geomspace
    # 0.1, not 0.09999999999999999: what a table of them is grouped and read by
    return [float(f"{x:.12g}") for x in spaced(first, last, int(count))]


def _draw(axes: list[SampledAxis], study: Study) -> list[Any]:
    """Per axis its `samples` values."""
    shares = _shares(axes, study)
    return [_distributed(axis, u) for axis, u in zip(axes, shares, strict=True)]


def _shares(axes: list[SampledAxis], study: Study) -> list[NDArray[np.float64]]:
    """Per axis `samples` numbers in [0, 1)."""
    sobol = [a for a in axes if a.kind == "sobol"]
    columns: Iterator[NDArray[np.float64]] = iter(())
    if sobol:
        columns = iter(_sobol(len(sobol), study).T)
    result: list[NDArray[np.float64]] = []
    for place, axis in enumerate(axes):
        if axis.kind == "sobol":
            result.append(np.ascontiguousarray(next(columns)))
        else:
            # a stream of its own per axis: another axis more or less changes no draws
            rng = np.random.default_rng([study.seed, place])
            result.append(rng.random(study.samples))
    return result


def _sobol(dimensions: int, study: Study) -> NDArray[np.float64]:
    """Points of a scrambled Sobol sequence, (samples, dimensions)."""
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
        # a count that is no power of two loses balance, not validity: the user's choice
        warnings.filterwarnings("ignore", "The balance properties", UserWarning)
        drawn: NDArray[np.float64] = sequence.random(study.samples)
    return drawn


def _distributed(axis: SampledAxis, u: NDArray[np.float64]) -> Any:
    """Numbers in [0, 1) as values of the axis, by the inverse of its distribution."""
    if axis.uniform is not None:
        low, high = axis.uniform
        return low + (high - low) * u
    if axis.loguniform is not None:
        low, high = (math.log(x) for x in axis.loguniform)
        return np.exp(low + (high - low) * u)
    if axis.normal is not None:
        mean, sigma = axis.normal
        tiny = 2.0**-53  # 0 stands for the first of 2**53 steps, not for minus infinity
        return mean + sigma * ndtri(np.maximum(u, tiny))
    if axis.integers is not None:
        first, last = axis.integers
        return first + np.floor(u * (last - first + 1)).astype(np.int64)
    choice = axis.choice or []
    return [choice[i] for i in np.floor(u * len(choice)).astype(int)]


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value
