"""Measured states with ages of their own: fed back as they are, or sent to an observer.

`[[measurements]]` of a system file say what is measured, how old and how noisy. Where they are
whole states, each once, without noise, and no `[observer]` is asked for, K acts on them at their
ages: the feedback of the system is theirs (`fed_back`). Otherwise an observer is designed with K.

What is sent and held is never of one age: between messages, and between the steps of a controller,
it grows older. So `d` of a measurement, and `command_age`, are the greatest of any age, unless the
file says that the age is constant: a system that can be designed for and that no run can show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cosim.core import Findings, InputError, format_value
from cosim.hinf.certificate import checked_measurements, counted_as, pair_of
from cosim.hinf.problem.system_file import ObserverPart, SystemFile
from cosim.models import DelaySystem, Matrix, Measurement


@dataclass(frozen=True)
class ObserverSettings:
    """What a file says of an observer; its fields are arguments of `design_output_feedback`.

    Attributes
    ----------
    measurements : what the observer receives.
    estimated : one truth value per state, False where it is known; None: all are estimated.
    command_age, command_any_age : greatest age at which the command acts; whether it varies.
    gain, injections : K and every L, where they are given.
    offset, initial_error, energy : of peaks that are to be proved; None and 0 without.
    at_once : whether the file says that commands act at once; otherwise a design is proved for
        commands that are held (`for_any_command`).
    """

    measurements: tuple[Measurement, ...]
    estimated: tuple[bool, ...] | None = None
    command_age: float = 0.0
    command_any_age: bool = False
    gain: Matrix | None = None
    injections: tuple[Matrix, ...] | None = None
    offset: tuple[float, ...] | None = None
    initial_error: tuple[float, ...] | None = None
    energy: float = 0.0
    at_once: bool = False


def fed_back(system: DelaySystem, measurements: Sequence[Measurement]) -> DelaySystem:
    """Return the system whose feedback is that of measured states, each at its own age.

    Parameters
    ----------
    system : Eq. (7) without feedback of its own.
    measurements : of whole states, each once at most, without noise.

    Raises
    ------
    InputError : naming the measurement.
    """
    checked_measurements(system, measurements)
    _refuse_feedback(system)
    n = len(system.A)
    for x in measurements:
        if x.states is None or any(x.noise):
            raise InputError(
                "only whole states without noise are fed back as they are measured",
                where=f"measurement {x.name}",
                expected="rows of C with a single one, no noise",
                got="noise" if any(x.noise) else f"C = {x.C.tolist()}",
                hint="an observer takes any: the table [observer], or design_output_feedback",
            )
    masks = [np.isin(np.arange(n), x.states or ()).tolist() for x in measurements]
    at_once = np.zeros(n, dtype=bool)
    delays = list(system.delays)
    for x, mask in zip(measurements, masks, strict=True):
        if x.d == 0:
            at_once |= mask
        else:
            delays.append(x.delay(n, mask))
    feedback = tuple(at_once.tolist()) if at_once.any() else None
    try:
        return replace(system, delays=tuple(delays), feedback=feedback)
    except ValueError as error:
        raise InputError(str(error), where="measurements") from error


def measured(
    file: SystemFile, system: DelaySystem, findings: Findings
) -> tuple[DelaySystem, ObserverSettings | None]:
    """Return what [[measurements]] and [observer] ask for: the system fed back, or an observer.

    Raises
    ------
    InputError : parts that do not fit together, with their place in the file.
    """
    n = len(system.A)
    if file.measurements is None:
        with findings.at("observer"):
            raise InputError("an observer of nothing", expected="[[measurements]] beside it")
    with findings.at("system"):
        _refuse_feedback(system, "system")
    sensors = []
    for i, part in enumerate(file.measurements):
        with findings.at("measurements", i):
            place = f"measurements[{i}].states"
            rows = np.eye(n)[_states(part.states, n, place)] if part.C is None else part.C
            given = "any_age" in part.model_fields_set
            sensors.append(part.measurement(rows, any_age=part.any_age and (given or part.d > 0)))
    measurements = tuple(sensors)
    with findings.at("measurements"):
        checked_measurements(system, measurements)
        states = [j for x in measurements if x.states is not None for j in x.states]
        exact_state = all(x.states is not None and not any(x.noise) for x in measurements)
        if file.observer is None and exact_state and sorted(states) == list(range(n)):
            return fed_back(system, measurements), None
    with findings.at("observer"):
        return system, _settings(file.observer or ObserverPart(), measurements, system)


def _states(numbers: list[int] | None, n: int, where: str) -> list[int]:
    """Return the indices of states that a file counts from 1."""
    if not numbers or len(set(numbers)) < len(numbers) or not set(numbers) <= {*range(1, n + 1)}:
        raise InputError(
            "not states of the system",
            where=where,
            expected=f"different numbers from 1 to {n}",
            got=format_value(numbers),
            hint="states are counted from 1, in the order of the rows of A",
        )
    return [x - 1 for x in numbers]


def _settings(
    part: ObserverPart, measurements: tuple[Measurement, ...], system: DelaySystem
) -> ObserverSettings:
    """Return the settings of [observer], and refuse what is no pair."""
    n, m = system.B.shape
    estimated = None
    if part.known is not None:
        known = [] if not part.known else _states([*{*part.known}], n, "observer.known")
        estimated = tuple(j not in known for j in range(n))
    injections = None
    if part.L is not None:
        if set(part.L) != {x.name for x in measurements}:
            raise InputError(
                "not one injection per measurement",
                where="observer.L",
                expected="a table with a matrix for " + ", ".join(x.name for x in measurements),
                got=", ".join(part.L) or "nothing",
            )
        injections = tuple(part.L[x.name] for x in measurements)
    age = part.command_age or 0.0
    any_age = part.command_any_age and age > 0  # a command is held until the next one
    pair_of(
        *(system, measurements, np.zeros((m, n)) if part.K is None else part.K),
        [np.zeros(x.C.T.shape) for x in measurements] if injections is None else injections,
        command_age=age,
        command_any_age=any_age,
        estimated=estimated,
    )
    return ObserverSettings(
        *(measurements, estimated, age, any_age, part.K, injections),
        offset=counted_as(part.offset, n, "observer.offset", "state"),
        initial_error=counted_as(part.initial_error, n, "observer.initial_error", "state"),
        energy=part.energy or 0.0,
        at_once=part.command_age == 0,
    )


def _refuse_feedback(system: DelaySystem, where: str | None = None) -> None:
    """Refuse a system that says itself how it is fed back."""
    if system.feedback is None and system.immediate_feedback and not system.integrals:
        return
    raise InputError(
        "feedback beside measurements: the ages of the feedback are those of the measurements",
        where=where or (f"{system.name}: feedback" if system.name else "feedback"),
        expected="no feedback, integral or weights by frequency in the system",
        got="integral action" if system.integrals else "feedback",
        hint="give each sensor a table [[measurements]], and the command's age to [observer]",
    )
