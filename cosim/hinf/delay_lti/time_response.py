"""Step, impulse, forced and initial response of a system with internal delays.

What is computed is a polynomial on every piece (`method_of_steps`); samples are
values of it. An input given by its samples, held or joined by straight lines, is a sum of steps or
ramps that begin at its samples, and so is the response: nothing is sampled but the input itself.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError, NotAchievableError
from cosim.hinf.delay_lti.blocks import Blocks, Reals
from cosim.hinf.delay_lti.method_of_steps import STAGES, Question, Solution, solve
from cosim.hinf.delay_lti.roots import roots_of

_CHECKED = STAGES + 6  # stages of the second computation that estimates the error
_POINTS = 501
_SETTLED = 7.0  # time constants
_LONGEST = 1e4  # in the shortest delay or time constant, where no time is given
_EVERY_PAIR = 4_000_000  # samples times instants that are formed at once


@dataclass(frozen=True, eq=False, repr=False)
class TimeResponse:
    """A response in time: `t, y = response`, as of python-control.

    Attributes
    ----------
    kind : "step", "impulse", "forced" or "initial".
    time : (k,) [s].
    outputs : (p, m, k), column j of a step or impulse on input j alone; (p, k) of a forced or
        initial response; (k,) where there is one output and one input. Right limits at jumps.
    impulses : of an impulse response, (time [s], weight (p, m)) of every impulse in the output
        itself, which no sample contains.
    """

    kind: str
    time: Reals
    outputs: Reals
    impulses: tuple[tuple[float, Reals], ...] = ()
    _again: Any = field(default=None)

    def __iter__(self) -> Iterator[Reals]:
        return iter((self.time, self.outputs))

    def __repr__(self) -> str:
        y = np.atleast_1d(self.outputs)
        return (
            f"<TimeResponse: {self.kind}, {self.time.size} samples to {self.time[-1]:g} s, "
            f"output {y.min():.4g} to {y.max():.4g}, last {np.ravel(y[..., -1])[0]:.4g}>"
        )

    @cached_property
    def error(self) -> float:
        """The largest difference to the same response computed with six more stages.

        An estimate, computed when it is asked for: rounding, as a rule 1e-15 to 1e-12 of the
        largest value.
        """
        return float(np.abs(self._again(_CHECKED) - self.outputs).max(initial=0.0))

    def plot(self, ax: Any = None) -> Any:
        """Draw it, one line per output and input; return matplotlib's axes.

        Raises
        ------
        InputError : matplotlib is not installed.
        """
        from cosim.hinf.delay_lti import draw_time  # noqa: PLC0415 - matplotlib

        return draw_time(self, ax)


def step_response(blocks: Blocks, t: ArrayLike | None = None) -> TimeResponse:
    """Compute the response to a unit step on each input, at rest before it.

    Parameters
    ----------
    t : times [s] from 0 on, rising; or one number, the end; None: until it has settled.

    Raises
    ------
    InputError : times that are none, or so long against the delays that no computer has room.
    """
    return _from_rest(blocks, t, "step", 0)


def impulse_response(blocks: Blocks, t: ArrayLike | None = None) -> TimeResponse:
    """Compute the response to a unit impulse on each input; otherwise as `step_response`."""
    return _from_rest(blocks, t, "impulse", -1)


def initial_response(
    blocks: Blocks,
    x0: ArrayLike,
    t: ArrayLike | None = None,
    *,
    before: Literal["rest", "constant"] = "rest",
) -> TimeResponse:
    """Compute the response without input from the state x0 (n,).

    Parameters
    ----------
    before : what the delays contain at first: "rest", zero; "constant", the state was x0 for ever.
    t : as of `step_response`.

    Raises
    ------
    InputError : x0 of the wrong size, or as `step_response`.
    """
    start = np.asarray(x0, dtype=np.float64).ravel()
    if start.shape != (blocks.order,) or not np.isfinite(start).all():
        raise InputError(
            "not an initial state",
            where="x0",
            expected=f"{blocks.order} finite numbers",
            got=str(start.shape),
        )
    past = np.zeros(blocks.delays.size)
    if before == "constant":
        past[:] = np.linalg.solve(np.eye(past.size) - blocks.Dvw, blocks.Cv @ start)
    elif before != "rest":
        raise InputError("not a history", where="before", expected="rest or constant", got=before)
    times = times_of(blocks, t)
    asked = Question(1, _nothing(blocks.inputs), None, start[:, None], past[:, None])

    def outputs(stages: int) -> Reals:
        y = solve(blocks, asked, float(times[-1]), stages).at(times)[:, :, 0]
        return y[0] if blocks.outputs == 1 else y

    return TimeResponse("initial", times, outputs(STAGES), (), outputs)


def forced_response(
    blocks: Blocks,
    t: ArrayLike,
    u: ArrayLike,
    *,
    hold: Literal["line", "constant"] = "line",
) -> TimeResponse:
    """Compute the response to an input given by its samples, at rest before the first.

    Parameters
    ----------
    t : (k,) times [s], rising, the first one where the input begins.
    u : (k,) or (m, k) values at these times.
    hold : "line": straight lines between samples, as in python-control; "constant": each value
        is kept until the next (zero-order hold).

    Raises
    ------
    InputError : times or values that do not fit.
    """
    times = _rising(t)
    values = np.atleast_2d(np.asarray(u, dtype=np.float64))
    if values.shape != (blocks.inputs, times.size) or not np.isfinite(values).all():
        raise InputError(
            "an input that does not fit the system",
            where="u",
            expected=f"finite numbers, {blocks.inputs} inputs by {times.size} times",
            got=str(np.shape(u)),
        )
    if hold not in ("line", "constant"):
        raise InputError("not a hold", where="hold", expected="line or constant", got=hold)
    order, parts = _parts_of_input(times, values, hold)

    def outputs(stages: int) -> Reals:
        y = np.zeros((blocks.outputs, times.size))
        for degree, weights in zip(order, parts, strict=True):
            y += _superposed(_unit(blocks, degree, times[-1] - times[0], stages), times, weights)
        return y[0] if blocks.outputs == 1 else y

    return TimeResponse("forced", times, outputs(STAGES), (), outputs)


def _parts_of_input(
    times: Reals, values: Reals, hold: str
) -> tuple[tuple[int, ...], tuple[Reals, ...]]:
    """Return the degrees (0 steps, 1 ramps) of an input's parts and what begins at each sample."""
    if hold == "constant":
        return (0,), (np.diff(values, axis=1, prepend=0.0),)
    first = np.zeros_like(values)
    first[:, 0] = values[:, 0]
    slopes = np.zeros_like(values)
    slopes[:, :-1] = np.diff(values, axis=1) / np.diff(times)
    return (0, 1), (first, np.diff(slopes, axis=1, prepend=0.0))


def _unit(blocks: Blocks, degree: int, end: float, stages: int) -> Solution:
    """Return the response to a unit step or ramp on every input."""
    m = blocks.inputs

    def ramp(t: Reals) -> Reals:
        shape = np.ones_like(t) if degree == 0 else t
        return np.eye(m)[:, None, :] * shape[None, :, None]

    rest, past = np.zeros((blocks.order, m)), np.zeros((blocks.delays.size, m))
    return solve(blocks, Question(m, ramp, degree, rest, past), end, stages)


def _superposed(unit: Solution, times: Reals, weights: Reals) -> Reals:
    """Return sum_k unit(t - t_k) weights_k over t_k <= t, (p, len(t))."""
    begins = np.flatnonzero(weights.any(axis=0))
    y = np.zeros((unit.values.shape[1], times.size))
    if not begins.size:
        return y
    steps = np.diff(times)
    if np.ptp(steps) <= 1e-12 * times[-1]:  # differences of times are those from the first
        response = unit.at(np.linspace(0.0, times[-1] - times[0], times.size))
        for k in begins.tolist():
            y[:, k:] += np.einsum("pkm,m->pk", response[:, : times.size - k], weights[:, k])
        return y
    block = max(1, _EVERY_PAIR // (times.size * weights.shape[0]))
    for i in range(0, begins.size, block):
        chosen = begins[i : i + block]
        gaps = times[None, :] - times[chosen, None]
        begun = gaps >= 0.0
        answers = np.zeros((unit.values.shape[1], *gaps.shape, weights.shape[0]))
        answers[:, begun] = unit.at(gaps[begun])
        y += np.einsum("pkti,ik->pt", answers, weights[:, chosen])
    return y


def _from_rest(
    blocks: Blocks, t: ArrayLike | None, kind: Literal["step", "impulse"], order: int
) -> TimeResponse:
    m = blocks.inputs
    if not blocks.D.size:
        raise InputError("this system has no response", where="system", expected="inputs, outputs")
    times = times_of(blocks, t)

    def steady(at: Reals) -> Reals:
        return np.eye(m)[:, None, :] * np.ones(at.size)[None, :, None]

    given = steady if order == 0 else _nothing(m, m)
    rest, past = np.zeros((blocks.order, m)), np.zeros((blocks.delays.size, m))
    asked = Question(m, given, order, rest, past)
    first = solve(blocks, asked, float(times[-1]))

    def outputs(stages: int) -> Reals:
        solved = first if stages == STAGES else solve(blocks, asked, float(times[-1]), stages)
        y = np.moveaxis(solved.at(times), 1, 2)
        return y[0, 0] if y.shape[:2] == (1, 1) else y

    return TimeResponse(kind, times, outputs(STAGES), first.impulses, outputs)


def _nothing(m: int, columns: int = 1) -> Any:
    return lambda t: np.zeros((m, t.size, columns))


def times_of(blocks: Blocks, t: ArrayLike | None) -> Reals:
    """Return checked times; from an end, or from none, 501 of them.

    Raises
    ------
    InputError : times that are none.
    """
    if t is None:
        t = _settling(blocks)
    if np.ndim(t) == 0:
        try:
            end = float(np.asarray(t))
        except (TypeError, ValueError):
            end = math.nan
        if not (math.isfinite(end) and end > 0.0):
            raise InputError("not an end", where="t", expected="seconds > 0", got=str(t))
        return np.linspace(0.0, end, _POINTS)
    times = _rising(t)
    if times[0] < 0.0:
        raise InputError("a time before 0", where="t", expected=">= 0", got=f"{times[0]:g}")
    return times


def _rising(t: ArrayLike) -> Reals:
    try:
        times = np.asarray(t, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("not times", where="t", expected="numbers of seconds") from error
    ok = times.ndim == 1 and times.size > 1 and np.isfinite(times).all()
    if not ok or not (np.diff(times) > 0.0).all():
        raise InputError(
            "not times",
            where="t",
            expected="two or more finite numbers of seconds, each later than the one before",
            got=f"shape {times.shape}",
        )
    return times


def _settling(blocks: Blocks) -> float:
    """Return an end [s] by which a response has settled, or shows where it goes."""
    total_delay = float(blocks.delays.sum())
    try:
        roots = roots_of(blocks, 8)
    except NotAchievableError:
        roots = np.zeros(0, dtype=np.complex128)
    speeds = np.abs(roots.real)[np.abs(roots.real) > 1e-9 * np.abs(roots).max(initial=0.0)]
    slowest = 1.0 / float(speeds.min()) if speeds.size else max(total_delay, 1.0)
    if roots.size and roots[0].real > 0.0:
        slowest = 1.0 / float(roots[0].real)  # it grows: seven of its time constants are enough
    fastest = min([slowest, *blocks.delays.tolist()])
    end = min(_SETTLED * slowest + 2.0 * total_delay, _LONGEST * fastest)
    digit = 10.0 ** math.floor(math.log10(end))
    return float(math.ceil(end / digit) * digit)
