"""Inputs driven by given signals: the path of a reference, the worst case of a design."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim import hinf
from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.master import CommunicationSchedule, Endpoint
from cosim.models import DelaySystem
from cosim.scenario.gain import observes
from cosim.scenario.matching import endpoint, members
from cosim.scenario.schema import DisturbancePart, PathPart
from cosim.scenario.units import in_unit_of

Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]
Signals = dict[Endpoint, Function]
"""Input -> its values at instants [s]."""


def reference_inputs(path: PathPart, fmus: Mapping[str, FmuDescription]) -> PathPart:
    """Convert every value of the path to the unit of the input that follows it.

    Raises
    ------
    InputError : no such component or input, or a value of another dimension.
    """
    base = endpoint(path.target)
    fmu = _fmu_at(base, fmus, "reference.target")
    ports = [
        fmu.port(_member(base.variable, axis), where=f"component {base.component!r}")
        for axis in path.axes
    ]
    points: list[list[Any]] = [
        [point[0]]
        + [
            in_unit_of(fmu, port, value, f"reference.points[{i}]")
            if isinstance(value, str)
            else value
            for port, value in zip(ports, point[1:], strict=True)
        ]
        for i, point in enumerate(path.points)
    ]
    return path.model_copy(update={"points": points})


def _member(group: str, axis: str) -> str:
    """Return the variable of a group: `group.x` for "x", `group[1]` for "[1]"."""
    return f"{group}{axis}" if axis.startswith("[") else f"{group}.{axis}"


def _fmu_at(base: Endpoint, fmus: Mapping[str, FmuDescription], where: str) -> FmuDescription:
    if base.component not in fmus:
        raise InputError.unknown("component", base.component, fmus, where=where)
    return fmus[base.component]


def along_path(path: PathPart, *, at_rest: bool) -> Signals:
    """Return the reference as signals; zero for a run `at_rest`."""
    points: NDArray[np.float64] = np.array(path.points)
    base = endpoint(path.target)
    driven: Signals = {}
    for j, axis in enumerate(path.axes):
        end = Endpoint(base.component, _member(base.variable, axis))
        driven[end] = np.zeros_like if at_rest else partial(_along, points, j, path.interpolation)
    return driven


def _along(
    points: NDArray[np.float64], axis: int, interpolation: str, seconds: NDArray[np.float64]
) -> NDArray[np.float64]:
    times, values = points[:, 0], points[:, 1 + axis]
    if times.size == 1:
        return np.full(seconds.size, values[0])
    place = np.clip(np.searchsorted(times, seconds, side="right") - 1, 0, times.size - 2)
    share = np.clip((seconds - times[place]) / (times[place + 1] - times[place]), 0.0, 1.0)
    if interpolation == "smooth":
        share = share * share * (3.0 - 2.0 * share)
    along: NDArray[np.float64] = values[place] + share * (values[place + 1] - values[place])
    return along


def worst_case_of(part: DisturbancePart, design: hinf.Result) -> hinf.delay_lti.WorstCase:
    """Return the sinusoid that the design's nominal loop amplifies most.

    That of the design; computed if it has none, or if a frequency is given. Of a design with an
    observer it is that of w alone: what else acts on its pair is the noise of measurements.

    Raises
    ------
    InputError : the norm is attained at no finite frequency, and none is given.
    """
    if observes(design):
        system, K = _without_noise(design), design.pair.gain
        known = part.omega is not None
        omega = part.omega if known else hinf.delay_lti.nominal_figures_of(system, K).norm_frequency
        found = hinf.delay_lti.worst_case_at(system, K, omega)
    elif part.omega is None and design.worst_case is not None:
        return design.worst_case
    else:
        omega = design.norm_frequency if part.omega is None else part.omega
        found = hinf.delay_lti.worst_case_at(design.system, design.K, omega)
    if found is None:
        raise InputError(
            "the norm of this loop is that of D1, approached as the frequency grows: no "
            "disturbance attains it",
            where="disturbance",
            expected="a peak at a finite frequency",
            got=f"|D1| = {np.linalg.norm(design.system.D1, 2):g}",
            hint="give a frequency: omega = ... [rad/s]",
        )
    return found


def _without_noise(design: hinf.Result) -> DelaySystem:
    """Return the pair of a design with w alone for its disturbance."""
    pair, q = design.pair.system, design.system.C.shape[1]
    return replace(pair, C=pair.C[:, :q], D1=pair.D1[:, :q])


def no_disturbance(system: DelaySystem) -> hinf.delay_lti.WorstCase:
    """Return a zero disturbance with the dimensions of `system`.

    Raises
    ------
    InputError : the system has no gain from w to z, hence no worst case.
    """
    if not system.has_performance:
        raise InputError(
            "this design has no worst case",
            where="disturbance",
            expected="a system with w and z: C, and D, D1 or D2",
            got=f"{system.name or 'a system'} without them: stability alone is certified",
        )
    zero = (0.0,) * system.C.shape[1]
    return hinf.delay_lti.WorstCase(0.0, zero, zero, 0.0)


def worst_case_inputs(
    part: DisturbancePart,
    found: hinf.delay_lti.WorstCase,
    fmus: Mapping[str, FmuDescription],
    comm_schedule: CommunicationSchedule,
) -> Signals:
    """Return the worst case from the start to the end of the run, which lasts T.

    Its envelope is sin(pi t / T): the measured gain is then short by O(1/T^2), instead of O(1/T)
    with a hard start and end.

    Raises
    ------
    InputError : the target does not have one input per entry of w, or the step is too long for
        the frequency.
    """
    base = endpoint(part.target)
    fmu = _fmu_at(base, fmus, "disturbance.target")
    names = list(members(fmu, base.variable, "input").values())
    if len(names) != len(found.amplitude):
        raise InputError(
            "the target does not fit the disturbance of the design",
            where="disturbance.target",
            expected=f"{len(found.amplitude)} inputs, one per entry of w",
            got=f"{part.target}: {', '.join(names) or 'no input'}",
        )
    longest = comm_schedule.step_ns / 1e9
    if found.omega * longest > math.pi:  # other points may lie between those a step apart
        longest = float(np.diff(comm_schedule.points_ns).max()) / 1e9
    if found.omega * longest > math.pi:
        raise InputError(
            "the communication step is too long for the worst case",
            where="run.step",
            expected=f"less than {math.pi / found.omega:.4g} s, half a period of "
            f"{found.omega:.4g} rad/s",
            got=f"{longest:g} s",
            hint="a tenth of that, since the disturbance is held between two points",
        )
    end, start = comm_schedule.end_ns / 1e9, comm_schedule.at_s(0)
    return {
        Endpoint(base.component, name): partial(
            _swelling, part.amplitude, size, phase, found.omega, end, start
        )
        for name, size, phase in zip(names, found.amplitude, found.phase, strict=True)
    }


def _swelling(
    amplitude: float,
    size: float,
    phase: float,
    omega: float,
    end: float,
    start: float,
    seconds: NDArray[np.float64],
) -> NDArray[np.float64]:
    # the C library's sine: the last bit of NumPy's varies by processor
    return np.array(
        [
            amplitude * math.sin(math.pi * t / end) * size * math.cos(omega * t + phase)
            for t in (seconds - start).tolist()
        ]
    )
