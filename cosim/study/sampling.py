"""Draw the points of sampled axes: how they are spread, correlated and distributed.

Every axis gets shares u in [0, 1) first, which the inverse of its distribution maps to values. The
first points of more samples are those of fewer, but for a Latin hypercube.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from cosim.core import InputError
from cosim.study.schema import SampledAxis, Study

Shares = NDArray[np.float64]
_TINY = 2.0**-53
"""In place of 0: the first of 2**53 steps, not minus infinity."""


def draw(axes: Sequence[SampledAxis], study: Study) -> list[Any]:
    """Return the `samples` values of each axis.

    Raises
    ------
    InputError : too many Sobol axes, or correlations that cannot be together.
    """
    if any(axis.kind == "saltelli" for axis in axes):
        shares = _saltelli([axis.kind for axis in axes], study)
    else:
        shares = _correlated(_independent(axes, study), [axis.column for axis in axes], study)
    return _given_each_other(axes, shares, distributed)


def _independent(axes: Sequence[SampledAxis], study: Study) -> Shares:
    """Return the shares of axes that are random, Sobol or Latin, (samples, axes)."""
    shares = np.empty((study.samples, len(axes)))
    for kind, made in (("sobol", _sobol), ("latin", _latin)):
        mine = [i for i, axis in enumerate(axes) if axis.kind == kind]
        if mine:
            shares[:, mine] = made(len(mine), study)
    for place, axis in enumerate(axes):
        if axis.kind == "random":
            # a stream of its own per axis: adding or removing another axis changes no draws
            shares[:, place] = np.random.default_rng([study.seed, place]).random(study.samples)
    return shares


def _sobol(dimensions: int, study: Study) -> Shares:
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
        drawn: Shares = sequence.random(study.samples)
    return drawn


def _saltelli(kinds: Sequence[str], study: Study) -> Shares:
    """Return samples (d + 2) points of d axes: of each sample A, A with column i of B, and B.

    A and B are the halves of the points of a Sobol sequence in 2 d dimensions (Saltelli et al.,
    Computer Physics Communications 181 (2010) 259).
    """
    if set(kinds) != {"saltelli"} or study.correlations:
        raise InputError(
            "sensitivity indices need independent axes of one kind",
            where="vary",
            expected="all sampled axes of kind 'saltelli', and no correlations",
            got=", ".join(kinds) + (" and correlations" if study.correlations else ""),
        )
    d = len(kinds)
    both = _sobol(2 * d, study)
    first, second = both[:, :d], both[:, d:]
    points = np.repeat(first[:, None, :], d + 2, axis=1)
    for i in range(d):
        points[:, i + 1, i] = second[:, i]
    points[:, -1] = second
    return points.reshape(-1, d)


def _latin(dimensions: int, study: Study) -> Shares:
    """Return a Latin hypercube: one point in each of `samples` equal intervals of each axis."""
    from scipy.stats import qmc  # noqa: PLC0415 - loading it takes half a second

    drawn: Shares = qmc.LatinHypercube(
        dimensions, rng=np.random.default_rng([study.seed, dimensions])
    ).random(study.samples)
    return drawn


def _correlated(shares: Shares, names: Sequence[str], study: Study) -> Shares:
    """Correlate the shares by a Gaussian copula; axes without a correlation stay as they are."""
    columns, factor = _cholesky(names, study)
    found = shares.copy()
    for column, total in _combined(columns, factor, _standard_normal(shares[:, columns])):
        found[:, column] = np.minimum(ndtr(total), 1.0 - _TINY)
    return found


def values_at(normal: Shares, axes: Sequence[SampledAxis], study: Study) -> list[Any]:
    """Return the values of each axis at independent standard normal numbers, (points, axes).

    Raises
    ------
    InputError : correlations that cannot be together.
    """
    correlated = normal.copy()
    columns, factor = _cholesky([axis.column for axis in axes], study)
    for column, total in _combined(columns, factor, normal[:, columns]):
        correlated[:, column] = total
    return _given_each_other(axes, correlated, _at_normal)


def _given_each_other(
    axes: Sequence[SampledAxis], drawn: Shares, values_of: Callable[[SampledAxis, Shares], Any]
) -> list[Any]:
    """Return the values of each axis, whose distribution may depend on an earlier axis."""
    found: dict[str, Any] = {}
    for axis, numbers in zip(axes, drawn.T, strict=True):
        u = np.ascontiguousarray(numbers)
        if axis.given is None:
            found[axis.column] = values_of(axis, u)
        else:
            each = (values_of(axis.at(x), u[i : i + 1]) for i, x in enumerate(found[axis.given]))
            found[axis.column] = np.array([value[0] for value in each])
    return list(found.values())


def _at_normal(axis: SampledAxis, z: Shares) -> Any:
    """Map standard normal numbers to values of the axis; far out, too, where shares are all 1."""
    for key, inverse in _OF_NORMAL.items():
        if (given := getattr(axis, key)) is not None:
            return inverse(z, *given)
    return distributed(axis, np.minimum(ndtr(z), 1.0 - _TINY))


def _combined(
    columns: Sequence[int], factor: Shares, normal: Shares
) -> Iterator[tuple[int, Shares]]:
    """Yield the correlated normal values of each column, but of the first, which stays."""
    # without BLAS, whose sums differ between machines
    for row, column in enumerate(columns[1:], 1):
        yield column, sum(factor[row, k] * normal[:, k] for k in range(row + 1))


def _cholesky(names: Sequence[str], study: Study) -> tuple[list[int], Shares]:
    """Return the columns of correlated axes, and a Cholesky factor of their correlations."""
    given = study.correlations
    mine = [name for name in names if any(name in one.axes for one in given)]
    matrix = np.eye(len(mine))
    for one in given:
        i, j = (mine.index(name) for name in one.axes)
        matrix[i, j] = matrix[j, i] = one.value
    try:
        factor: Shares = np.linalg.cholesky(matrix).astype(np.float64)
    except np.linalg.LinAlgError:
        raise InputError(
            "these correlations cannot be together",
            where="correlations",
            expected="a positive definite matrix of correlations; its least eigenvalue is above 0",
            got=f"a least eigenvalue of {np.linalg.eigvalsh(matrix)[0]:.3g}",
        ) from None
    return [names.index(name) for name in mine], factor


def distributed(axis: SampledAxis, u: Shares) -> Any:
    """Map numbers in [0, 1) to values of the axis, by the inverse of its distribution."""
    for key, inverse in _INVERSES.items():
        if (given := getattr(axis, key)) is not None:
            return inverse(u, *given)
    if axis.empirical is not None:
        known = np.sort(axis.empirical)
        return np.interp(u * (known.size - 1), np.arange(known.size), known)
    choice = axis.choice or []
    if axis.weights is None:
        return [choice[i] for i in np.floor(u * len(choice)).astype(int)]
    steps = np.cumsum(axis.weights) / math.fsum(axis.weights)
    return [choice[i] for i in np.minimum(np.searchsorted(steps, u, "right"), len(choice) - 1)]


def _standard_normal(u: Shares) -> Shares:
    found: Shares = ndtri(np.maximum(u, _TINY))
    return found


def _uniform(u: Shares, low: float, high: float) -> Shares:
    return low + (high - low) * u


def _loguniform(u: Shares, low: float, high: float) -> Shares:
    return np.exp(_uniform(u, math.log(low), math.log(high)))


def _triangular(u: Shares, low: float, mode: float, high: float) -> Shares:
    width = high - low
    rising = low + np.sqrt(u * width * (mode - low))
    falling = high - np.sqrt((1.0 - u) * width * (high - mode))
    return np.where(u * width < mode - low, rising, falling)


def _normal(z: Shares, mean: float, sigma: float) -> Shares:
    return mean + sigma * z


def _lognormal(z: Shares, median: float, sigma: float) -> Shares:
    found: Shares = median * np.exp(sigma * z)
    return found


def _integers(u: Shares, first: int, last: int) -> NDArray[np.int64]:
    return first + np.floor(u * (last - first + 1)).astype(np.int64)


_INVERSES: Mapping[str, Callable[..., Any]] = MappingProxyType(
    {
        "uniform": _uniform,
        "loguniform": _loguniform,
        "normal": lambda u, *given: _normal(_standard_normal(u), *given),
        "lognormal": lambda u, *given: _lognormal(_standard_normal(u), *given),
        "triangular": _triangular,
        "integers": _integers,
    }
)
_OF_NORMAL = MappingProxyType({"normal": _normal, "lognormal": _lognormal})
