"""Measurement age: time since the measurement behind the command in force was taken.

A design "for any age up to d" is about this age. It includes the link to the controller, the
wait for its sample instant and its communication step, the step that the coupling adds, the
link back, and the hold until the next command arrives.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master import Algorithm
from cosim.scenario.measure import Fold, MeasuredRun, measure
from cosim.scenario.stamps import NONE_IN_USE, FeedbackStamps

Integers = NDArray[np.int64]


class MeasuredAges(NamedTuple):
    """Ages of the measurements behind the commands in force, over a run.

    Attributes
    ----------
    least_ns, greatest_ns : over all instants [ns].
    in_use_ns : least and greatest age at the instants at which a measurement comes into use [ns].
        The measurement of t = 0 counts neither here nor for the least age: it stands for all
        before it, since the state is constant there. None where no other came into use.
    first_ns : the first of these instants [ns].
    alike : of parallel links, the measurements in use were always equally old.
    interrupted : after the first one, there was a time without a measurement in use.
    """

    least_ns: int | None
    greatest_ns: int
    in_use_ns: tuple[int, int] | None
    first_ns: int
    alike: bool
    interrupted: bool = False


Watch = Callable[[Integers, Integers], None]
"""Is called with points [ns], and the ages of the measurements in use at the ends of the intervals
before them [ns]; -1 where there was none."""


@measure
def measured_ages(
    run: MeasuredRun,
    plant: str,
    controller: str,
    algorithm: Algorithm = "jacobi",
    watch: Watch | None = None,
    states: Collection[str] | None = None,
) -> Fold[MeasuredAges | None]:
    """Measure the measurement ages over the run; None if no measurement came into use.

    Intervals in which no measurement is in use yet, or a link's substitute replaces it, do not
    count. Of several parallel links, the oldest measurement counts for every age but the least.

    states : inputs of the controller whose ages are measured; None: of all.
    """
    loop = run.shared(FeedbackStamps, plant, controller, algorithm)
    ages, before = None, NONE_IN_USE
    if not (ways := loop.ways(states)):
        return None
    while block := (yield):
        points, (oldest, newest) = run.points_ns(block), loop.in_use(block, ways)
        ages = ages_with(ages, points, oldest, newest, before)
        before = int(oldest[-1]) if oldest.size else before
        if watch is not None and oldest.size:
            watch(points[1:], ages_at(points[1:], oldest))
    return ages


def ages_at(points_ns: Integers, taken_ns: Integers) -> Integers:
    """Return the ages at points of what was taken at instants [ns]; -1 where there is none."""
    return np.where(taken_ns >= 0, points_ns - taken_ns, NONE_IN_USE)


def ages_with(
    ages: MeasuredAges | None, points: Integers, oldest: Integers, newest: Integers, before: int
) -> MeasuredAges | None:
    """Return ages with those in further intervals between points [ns].

    oldest, newest : when measurements in use in the intervals were taken [ns]; -1 where none is.
    before : `oldest` of the interval before.
    """
    there, begins = oldest >= 0, points[:-1]
    if ages is not None and not there.all():
        ages = ages._replace(interrupted=True)
    if not there.any():
        return ages
    first = int(np.argmax(there))
    if ages is None:
        interrupted = not there[first:].all()
        ages = MeasuredAges(None, 0, None, int(begins[first]), alike=True, interrupted=interrupted)
    comes = (begins - oldest)[(oldest > 0) & (np.diff(oldest, prepend=before) != 0)]
    in_use = [*(ages.in_use_ns or ()), *comes.tolist()]
    young = [*(begins - newest)[oldest > 0].tolist(), ages.least_ns]
    return ages._replace(
        least_ns=min((age for age in young if age is not None), default=None),
        greatest_ns=max(ages.greatest_ns, int((points[1:] - oldest)[there].max())),
        in_use_ns=(min(in_use), max(in_use)) if in_use else None,
        alike=ages.alike and bool((oldest == newest)[there].all()),
    )
