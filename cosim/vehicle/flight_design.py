"""The design of a flight: observer and gain, for as much of the envelope as can be certified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim import hinf
from cosim.core import InputError, NotAchievableError
from cosim.models import DelaySystem, Measurement
from cosim.vehicle.design_model import Say
from cosim.vehicle.flight_plan import FlightSettings, PlannedSensor, planned_sensors
from cosim.vehicle.linearisation import LinearModel, linear_model

DESIGN = "design.json"
"""The design in the folder of a flight."""

_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.125, 0.09, 0.06)
"""Shares of the envelope, of which the greatest is sought that is certified."""
_TRIES = 4
_ROOM = 0.7
"""Of the gain round F at which a smaller share is tried: it is about proportional to the share."""

_POOR = 4.0
"""Gamma over the exact norm above which half of the envelope is tried as well."""

Certified = tuple[LinearModel, tuple[PlannedSensor, ...], hinf.Result]


def certified_design(
    on_envelope: LinearModel, settings: FlightSettings, folder: Path, say: Say
) -> Certified:
    """Return model, sensors and design; where nothing good is certified, for a smaller envelope.

    Raises
    ------
    NotAchievableError : nothing was certified; says which states are the most uncertain.
    """
    refused: list[str] = []
    poor: Certified | None = None
    share, i, start = 1.0, 0, None
    for _ in range(_TRIES):
        share, craft, model = _SHARES[i], on_envelope.vehicle, on_envelope
        if share < 1.0:
            envelope = {name: share * bound for name, bound in craft.envelope.items()}
            model = linear_model(craft, envelope=envelope)
        sensors = planned_sensors(craft.sensors, model.states, settings)
        measured = measurements_of(model, sensors)
        try:
            design = made_before(model, measured, settings.command_age, folder, say)
            known = known_delays(model.system)
            design = design or hinf.design_output_feedback(
                *(known, measured),
                start=start,
                command_age=settings.command_age,
                command_any_age=True,
                estimated=estimated_states(known),
                quick=True,
            )
        except NotAchievableError as error:
            refused.append(f"for {share:g} of the envelope: {error.what}, {error.got}")
            least = 0.0
            if isinstance(error, hinf.synthesis.TooUncertainError):
                least, start = error.gain, error.start
            smaller = [k for k in range(i + 1, len(_SHARES)) if _SHARES[k] * least < _ROOM * share]
            if not smaller or poor is not None:
                break
            i = smaller[0]
            continue
        half = [k for k, each in enumerate(_SHARES) if each <= share / 2]
        if poor is None and half and _ratio(design) > _POOR:
            poor, start, i = (model, sensors, design), (design.K, design.L), half[0]
            continue
        if poor is not None and not _ratio(design) < _ratio(poor[2]) / 2:
            break
        return _with_remarks((model, sensors, design), on_envelope, say)
    if poor is not None:
        return _with_remarks(poor, on_envelope, say)
    raise NotAchievableError(
        "no observer and gain could be certified",
        where=on_envelope.vehicle.name,
        expected="a proof for some share of the envelope",
        got="; ".join(refused),
        hint=f"{_most_uncertain(on_envelope)}another [trim], sensors on board that are faster "
        "(age), a faster `link`, other controlled states ([control] states), or a sensor of "
        "a state that none measures",
    )


def _ratio(design: hinf.Result) -> float:
    """Return gamma over the exact norm of the nominal pair."""
    return (design.gamma or 0.0) / (design.exact_norm or 1.0)


def _with_remarks(designed: Certified, on_envelope: LinearModel, say: Say) -> Certified:
    """Return what was certified; say so where that is not for the whole envelope."""
    if designed[0] is not on_envelope:
        bounds = ", ".join(f"{name} {bound:.3g}" for name, bound in designed[0].envelope.items())
        say(f"certified for less than the whole envelope; about the trim at most: {bounds}")
    return designed


def proved_for(
    model: LinearModel,
    design: hinf.Result,
    measured: Sequence[Measurement],
    envelope: dict[str, float],
) -> tuple[LinearModel, hinf.Result] | None:
    """Return the same gains, certified for another envelope; None where they are not."""
    other = linear_model(model.vehicle, envelope=envelope)
    known = known_delays(other.system)
    try:
        designed = hinf.design_output_feedback(
            *(known, measured),
            gain=design.K,
            injections=design.L,
            command_age=design.pair.command_age,
            command_any_age=design.pair.command_any_age,
            estimated=estimated_states(known),
            quick=True,
        )
    except NotAchievableError:
        return None
    return other, designed


def _most_uncertain(model: LinearModel) -> str:
    """Say which entries of A have the uncertainty that moves a state most; nothing without any."""
    system = model.system
    bounds = np.array([model.envelope.get(name, 1.0) for name in model.states])
    radius = np.abs(system.E) @ np.abs(system.H[:, : len(bounds)])
    moves = (np.abs(system.A) * bounds).sum(axis=1, keepdims=True)
    shares = np.divide(radius * bounds, moves, out=np.zeros_like(radius), where=moves > 0)
    places = np.argsort(-shares, axis=None, kind="stable")[:3]
    entries = [np.unravel_index(k, shares.shape) for k in places]
    listed = ", ".join(
        f"{model.states[i]}' by {model.states[j]} ({system.A[i, j]:.3g} +- {radius[i, j]:.3g})"
        for i, j in entries
        if radius[i, j] > 0
    )
    return f"most uncertain is {listed}: smaller bounds of these in [envelope], " if listed else ""


def measurements_of(
    model: LinearModel, sensors: Sequence[PlannedSensor]
) -> tuple[Measurement, ...]:
    """Return the measurements of the design: rows of x, each with its age and its noise."""
    n = len(model.states)
    measurements = []
    for sensor in sensors:
        rows = np.zeros((len(sensor.measures), n))
        for k, name in enumerate(sensor.measures):
            rows[k, model.states.index(name)] = 1.0
        ages: dict[str, Any] = {"any_age": True, "noise": list(sensor.noise), "over": sensor.over}
        measurements.append(Measurement(sensor.name, rows, sensor.age, **ages))
    return tuple(measurements)


def made_before(
    model: LinearModel,
    measured: Sequence[Measurement],
    command_age: float,
    folder: Path,
    say: Say,
) -> hinf.Result | None:
    """Return the design for this model and these measurements that is in the folder, if one is.

    A solver's last digits never decide what flies: a design is kept, and its proof checked again.
    One that was proved for commands of another age keeps its K and L where these are proved for
    this one.
    """
    place = folder / DESIGN
    try:
        content = place.read_bytes()
    except OSError:
        return None
    data = hinf.certificate.certificate_from_bytes(content, str(place))
    if not _same_question(data, model, measured):
        return None
    designed = hinf.Result.from_json(data, where=str(place))
    if designed.observer is None:
        return None
    pair = designed.pair
    if (pair.command_age, pair.command_any_age) == (command_age, True):
        say(f"made before, its proof checked again: {place}")
        return designed
    asked = f"for commands of any age up to {command_age:g} s: {place}"
    try:
        again = hinf.design_output_feedback(
            *(pair.plant, pair.measurements),
            gain=pair.K,
            injections=pair.L,
            command_age=command_age,
            command_any_age=True,
            estimated=pair.estimated.tolist(),
            quick=True,
        )
    except NotAchievableError:
        say(f"made before, but its K and L are not proved {asked}")
        return None
    say(f"made before; its K and L are proved {asked}")
    return again


def _same_question(data: Any, model: LinearModel, measured: Sequence[Measurement]) -> bool:
    """Whether a certificate is about this plant and these measurements, as far as noise goes."""
    try:
        pair = hinf.certificate.pair_from_json(data)
    except (InputError, KeyError, TypeError):
        return False
    given = [(m.name, m.C.tolist(), m.delay(len(model.states)).description) for m in measured]
    keys = [
        (m.name, m.C.tolist(), m.delay(len(pair.plant.A)).description) for m in pair.measurements
    ]
    noise = all(
        np.allclose(a.noise, b.noise, rtol=1e-3)  # rounded up, so that products are exact
        for a, b in zip(measured, pair.measurements, strict=False)
    )
    same = hinf.certificate.first_difference(known_delays(model.system), pair.plant) is None
    return keys == given and noise and same


def known_delays(system: DelaySystem) -> DelaySystem:
    """Return a system with the delays inside the plant constant: an observer must know them."""
    delays = [replace(d, any_age=False) if not d.feedback else d for d in system.delays]
    return replace(system, delays=tuple(delays))


def estimated_states(system: DelaySystem) -> list[bool]:
    """Return which states must be estimated: not what a lag makes of the commands alone."""
    A = np.abs(system.A) + sum((np.abs(d.A) for d in system.delays), np.zeros_like(system.A))
    driven = np.asarray(np.hstack([system.C, system.E]).any(axis=1))
    commanded = np.asarray(system.B.any(axis=1))
    return [bool(driven[i] or not commanded[i] or np.delete(A[i], i).any()) for i in range(len(A))]
