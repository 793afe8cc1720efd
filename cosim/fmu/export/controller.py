"""Export a saved design as a controller FMU with gain, limits, certificate and page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cosim.core import InputError, Seconds, counted, seconds
from cosim.fmu.export.components import component_module
from cosim.fmu.export.fmu_file import FmuTarget, checked_name, model_name, write_fmu
from cosim.fmu.export.parts_of_design import vehicle_settings
from cosim.fmu.export.spec import ComponentSpec
from cosim.hinf import Result, auv_system, check_certificate
from cosim.hinf.certificate import certificate_bytes, certificate_hash, system_from_json
from cosim.hinf.problem import DEFAULT_ENVELOPE, AuvDesignSettings
from cosim.models import STATE, DelaySystem

_VARIABLES = component_module("hinf_controller.variables")
_OBSERVER = component_module("observer.variables")

Form = Literal["vehicle", "system", "output-feedback", "observer"]
"""Inputs and outputs: measured eta, nu to thrust; measured x[j] to u[i], as in Eq. (7); stamped
measurements to u[i]; or stamped measurements and the u[i] that act to the estimate."""


@dataclass(frozen=True)
class ControllerFmu:
    """An exported controller FMU.

    Attributes
    ----------
    path, name : the file and its model name.
    kind : flavour and platforms.
    form : its inputs and outputs.
    K : (m, n) its gain.
    claim : what its certificate proves.
    sha256 : of its certificate.
    """

    path: Path
    name: str
    kind: FmuTarget
    form: Form
    K: list[list[float]]
    claim: dict[str, Any]
    sha256: str


def export_controller(
    data: Any,
    path: Path,
    *,
    where: str = "the design",
    kind: FmuTarget | None = None,
    name: str | None = None,
    **settings: Any,
) -> ControllerFmu:
    """Write the FMU of a gain after checking its proof.

    Parameters
    ----------
    data : a design, or a design or certificate as JSON values.
    path : the FMU to write.
    where : the origin of `data`, for messages.
    name : of the model; by default the stem of `path`.
    settings : as of `controller_spec`.

    Raises
    ------
    InputError : as `controller_spec`; no compiler, or a file that cannot be written.
    """
    chosen = model_name(path) if name is None else checked_name(name)
    kind = kind or FmuTarget()
    spec, form, proved = controller_spec(data, chosen, where=where, **settings)
    write_fmu(spec, path, kind)
    sha256 = certificate_hash(proved)
    return ControllerFmu(path, spec.name, kind, form, proved["K"], proved["claim"], sha256)


def controller_spec(
    data: Any,
    name: str,
    *,
    where: str = "the design",
    sample_time: Seconds | None = None,
    limits: Sequence[float] | None = None,
    observer: bool = False,
    watch: bool = False,
    envelope: Sequence[float] | None = None,
) -> tuple[ComponentSpec, Form, dict[str, Any]]:
    """Specify the controller of a gain, after checking its proof; return its form and proof too.

    Parameters
    ----------
    data : a design, or a design or certificate as JSON values.
    name : of the model.
    where : the origin of `data`, for messages.
    sample_time : start value [s], or a text with a unit; by default 0.05 for the vehicle and 0
        (every communication point) for any other system.
    limits : for the vehicle, of each thrust [N] and of the moment [N m]; otherwise one per
        command, by default none, or those of the actuators in the design of a vehicle file.
    observer : of an output feedback, only its observer.
    watch : report the use of the assumptions by outputs, as the FMU of an output feedback does in
        any case.
    envelope : a bound for each measured state, or estimate, 0 for none; by default none, and of a
        vehicle those of its design.

    Raises
    ------
    InputError : no certificate, a proof that does not hold, no control input, a sample time or
        limits that do not fit.
    """
    if isinstance(data, Result):
        proof, data = data.check(), data.to_json()
    else:
        proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)
    if "K" not in data:
        raise InputError(
            "there is no gain to pack", where=where, got=f"a proof of kind {data['kind']}"
        )
    observed = data.get("kind") == "output-feedback"
    if observer and not observed:
        raise InputError(
            "there is no observer to pack",
            where=where,
            expected="the design of an output feedback",
            got="a gain of measured states",
        )
    system = system_from_json(data["plant" if observed else "system"])
    m = system.B.shape[1]
    if m == 0:
        raise InputError(
            "there is no gain to pack",
            where=where,
            expected="a system with a control input (B)",
            got="the analysis of a system without control",
        )
    form: Form = "vehicle" if is_vehicle(system) else "system"
    if observed:
        form = "observer" if observer else "output-feedback"
    own = vehicle_settings(data) if observed else {}
    settings = _settings(sample_time, limits, form, len(own["outputs"]) if own else m)
    bounds = _bounds(envelope, len(system.A) - system.integrals)
    if bounds and not (watch or observed):
        raise InputError("an envelope is only watched", where="`envelope`", hint="`watch`")
    given = {"envelope": bounds} if bounds or not own else {}
    given |= {key: x for key, x in settings.items() if limits is not None or key != "limits"}
    spec = _spec(form, name, certificate_bytes(data), {**own, **given}, settings)
    if watch and not observed:
        spec = _watched(spec, system, form, bounds)
    return spec, form, {**data, "claim": proof.claim}


def _spec(
    form: Form,
    name: str,
    certificate: bytes,
    observed: dict[str, Any],
    settings: dict[str, Any],
) -> ComponentSpec:
    """Return the specification of a controller; `observed`: settings of one with an observer."""
    spec: ComponentSpec
    if form == "vehicle":
        spec = _VARIABLES.vehicle_spec(name, certificate, **settings)
    elif form == "output-feedback":
        spec = _OBSERVER.output_feedback_spec(name, certificate, **observed)
    elif form == "observer":
        alone = {key: observed.get(key) for key in ("envelope", "trim_measured")}
        units = observed.get("units", ())
        spec = _OBSERVER.observer_spec(name, certificate, units=units, **alone)
    else:
        about = "Sampled state feedback with a certified gain, Eq. (8)"
        spec = _VARIABLES.feedback_spec(name, certificate, description=about, **settings)
    return spec


def _watched(
    spec: ComponentSpec, system: DelaySystem, form: Form, bounds: dict[int, float]
) -> ComponentSpec:
    """Return a state feedback that reports the use of its assumptions."""
    if form == "vehicle":
        named = {STATE[i - 1]: bound for i, bound in bounds.items()} or _vehicle_envelope(system)
    else:
        named = {f"x[{i}]": bound for i, bound in bounds.items()}
    watched: ComponentSpec = _VARIABLES.watched_spec(
        spec, age=system.feedback_delay, envelope=named
    )
    return watched


def _bounds(envelope: Sequence[float] | None, states: int) -> dict[int, float]:
    """Return the bounds of an envelope by the number of a state, from 1."""
    values = list(envelope or ())
    fits = len(values) in (0, states) and all(math.isfinite(x) and x >= 0 for x in values)
    if not fits:
        raise InputError(
            "the envelope does not fit the states",
            where="`envelope`",
            expected=f"{counted(states, 'number')} >= 0, one per state; 0: no bound",
            got=", ".join(map(repr, values)),
        )
    return {i: x for i, x in enumerate(values, 1) if x > 0}


def _vehicle_envelope(system: DelaySystem) -> dict[str, float]:
    """Return the default envelope of the vehicle by signal, if E and H of a system are its own."""
    own = auv_system(AuvDesignSettings())
    n = len(own.A)
    same = system.E.shape[1] == own.E.shape[1] and len(system.H) == len(own.H)
    if not (same and np.allclose(system.E[:n], own.E) and np.allclose(system.H[:, :n], own.H)):
        return {}
    bounds = asdict(DEFAULT_ENVELOPE)
    return {"eta.psi": bounds.pop("psi"), **{f"nu.{axis}": x for axis, x in bounds.items()}}


def is_vehicle(system: DelaySystem) -> bool:
    """Whether x = (eta, nu) and u is an acceleration, as in the built-in system `auv`.

    Integrals that the controller keeps may be further states.
    """
    n = len(system.A) - system.integrals
    if n != 8 or system.B.shape[1] != 4:
        return False
    zero, one = np.zeros((4, 4)), np.eye(4)
    rigid = np.array_equal(system.A[:n, :n], np.block([[zero, one], [zero, zero]]))
    measured = bool(system.measured[:n].all())
    return measured and rigid and np.array_equal(system.B[:n], np.vstack([zero, one]))


def _settings(
    sample_time: Seconds | None, limits: Sequence[float] | None, form: Form, m: int
) -> dict[str, Any]:
    """Check sample time and limits, and return them with their defaults."""
    usual = (0.05, tuple(_VARIABLES.LIMITS)) if form == "vehicle" else (0.0, ())
    chosen = usual[0] if sample_time is None else seconds(sample_time, "sample_time")
    bounds = usual[1] if limits is None else tuple(limits)
    if not (math.isfinite(chosen) and chosen >= 0):
        raise InputError(
            "not a sample time", where="`sample_time`", expected="seconds >= 0", got=repr(chosen)
        )
    wanted = 2 if form == "vehicle" else m
    fits = len(bounds) == wanted or (form != "vehicle" and not bounds)
    if not fits or not all(math.isfinite(value) and value >= 0 for value in bounds):
        raise InputError(
            "the limits do not fit the controller",
            where="`limits`",
            expected="largest thrust [N] and largest moment [N m]"
            if form == "vehicle"
            else f"{counted(m, 'number')} >= 0, one per command",
            got=", ".join(map(repr, bounds)),
        )
    return {"sample_time": chosen, "limits": bounds}
