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
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate import (
    checked_measurements,
    known_keys,
    matrix_from_rows,
    measurements_from_json,
    number,
    pair_of,
    seconds,
)
from cosim.hinf.exact import format_value
from cosim.hinf.problem.system_keys import OBSERVER
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


def measured_from_tables(
    data: dict[str, Any], system: DelaySystem, where: str
) -> tuple[DelaySystem, ObserverSettings | None]:
    """Read [[measurements]] and [observer] of a file: the system fed back, or an observer.

    Raises
    ------
    InputError : naming the key, what was expected and what was got.
    """
    n = len(system.A)
    if "measurements" not in data:
        raise InputError(
            "an observer of nothing",
            where=f"{where}: observer",
            expected="[[measurements]] beside it",
        )
    _refuse_feedback(system, f"{where}: system")
    own = tuple(measurements_from_json(data["measurements"], f"{where}: measurements", n))
    try:
        checked_measurements(system, own)
    except InputError as error:
        raise _inside(error, where) from error
    if "observer" not in data:
        states = [j for x in own if x.states is not None for j in x.states]
        whole = all(x.states is not None and not any(x.noise) for x in own)
        if whole and sorted(states) == list(range(n)):
            return fed_back(system, own), None
    settings = _settings(data.get("observer", {}), own, system, f"{where}: observer")
    return system, settings


def _settings(
    table: Any, own: tuple[Measurement, ...], system: DelaySystem, where: str
) -> ObserverSettings:
    """Read [observer], and refuse what is no pair."""
    known_keys(table, where, tuple(OBSERVER))
    n, m = system.B.shape
    estimated = None
    if "known" in table:
        known = table["known"]
        fits = isinstance(known, list) and all(
            isinstance(x, int) and not isinstance(x, bool) and 1 <= x <= n for x in known
        )
        if not fits:
            raise InputError(
                "not states of the system",
                where=f"{where}.known",
                expected=f"a list of numbers from 1 to {n}",
                got=format_value(known),
            )
        estimated = tuple(j not in known for j in range(1, n + 1))
    late = table.get("command_any_age", True)  # a command is held until the next one
    if not isinstance(late, bool):
        raise InputError(
            "not a truth value",
            where=f"{where}.command_any_age",
            expected="true or false",
            got=format_value(late),
        )
    age = seconds(table.get("command_age", 0.0), f"{where}.command_age")
    late = late and age > 0
    gain = matrix_from_rows(table["K"], f"{where}.K") if "K" in table else None
    injections = None
    if "L" in table:
        rows = table["L"]
        if not isinstance(rows, dict) or set(rows) != {x.name for x in own}:
            raise InputError(
                "not one injection per measurement",
                where=f"{where}.L",
                expected="a table with a matrix for " + ", ".join(x.name for x in own),
                got=format_value(rows),
            )
        injections = tuple(matrix_from_rows(rows[x.name], f"{where}.L.{x.name}") for x in own)
    peaks: dict[str, Any] = {}
    for key in (key for key in ("offset", "initial_error") if key in table):
        values = table[key] if isinstance(table[key], list) else [None]
        if len(values) != n:
            raise InputError(
                "not one number per state",
                where=f"{where}.{key}",
                expected=f"a list of {n}",
                got=format_value(table[key]),
            )
        peaks[key] = tuple(number(x, f"{where}.{key}[{i}]") for i, x in enumerate(values))
    peaks["energy"] = number(table.get("energy", 0.0), f"{where}.energy")
    if "offset" not in table and len(peaks) + ("energy" in table) > 1:
        raise InputError(
            "peaks from no initial state", where=where, expected="offset, zeros where it is zero"
        )
    at_once = "command_age" in table and age == 0
    settings = ObserverSettings(
        own, estimated, age, late, gain, injections, **peaks, at_once=at_once
    )
    try:
        pair_of(
            *(system, own, np.zeros((m, n)) if gain is None else gain),
            [np.zeros(x.C.T.shape) for x in own] if injections is None else injections,
            command_age=age,
            command_any_age=late,
            estimated=estimated,
        )
    except InputError as error:
        raise _inside(error, where) from error
    return settings


def _inside(error: InputError, where: str) -> InputError:
    """Return the error with the file and table in front of its place."""
    error.where = where if error.where is None else f"{where}: {error.where}"
    error.args = (error.text(),)
    return error


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
