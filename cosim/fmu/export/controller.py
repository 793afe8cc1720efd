"""Export a saved design as a controller FMU with gain, limits, certificate and page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cosim.core import InputError, counted
from cosim.fmu.export.components import component_module
from cosim.fmu.export.fmu_file import FmuTarget, checked_name, model_name, write_fmu
from cosim.fmu.export.spec import ComponentSpec
from cosim.hinf import certificate_bytes, certificate_hash, check_certificate, system_from_json
from cosim.models import DelaySystem

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
    where: str,
    kind: FmuTarget,
    name: str | None = None,
    sample_time: float | None = None,
    limits: Sequence[float] | None = None,
    observer: bool = False,
) -> ControllerFmu:
    """Write the FMU of a gain after checking its proof.

    Parameters
    ----------
    data : a design or certificate, as JSON values.
    path : the FMU to write.
    where : the origin of `data`, for messages.
    name : of the model; by default the stem of `path`.
    sample_time : start value [s]; by default 0.05 for the vehicle and 0 (every communication
        point) for any other system.
    limits : for the vehicle, of each thrust [N] and of the moment [N m]; otherwise one per
        command, by default none.
    observer : of an output feedback, only its observer.

    Raises
    ------
    InputError : no certificate, a proof that does not hold, no control input, a sample time or
        limits that do not fit, no compiler, or a file that cannot be written.
    """
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
    chosen = model_name(path) if name is None else checked_name(name)
    settings = _settings(sample_time, limits, form, m)
    spec: ComponentSpec
    certificate = certificate_bytes(data)
    if form == "vehicle":
        spec = _VARIABLES.vehicle_spec(chosen, certificate, **settings)
    elif form == "output-feedback":
        spec = _OBSERVER.output_feedback_spec(chosen, certificate, **settings)
    elif form == "observer":
        spec = _OBSERVER.observer_spec(chosen, certificate)
    else:
        about = "Sampled state feedback with a certified gain, Eq. (8)"
        spec = _VARIABLES.feedback_spec(chosen, certificate, description=about, **settings)
    write_fmu(spec, path, kind)
    return ControllerFmu(
        path, spec.name, kind, form, data["K"], proof.claim, certificate_hash(data)
    )


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
    sample_time: float | None, limits: Sequence[float] | None, form: Form, m: int
) -> dict[str, Any]:
    """Check sample time and limits, and return them with their defaults."""
    usual = (0.05, tuple(_VARIABLES.LIMITS)) if form == "vehicle" else (0.0, ())
    chosen = usual[0] if sample_time is None else sample_time
    bounds = usual[1] if limits is None else tuple(limits)
    if not (math.isfinite(chosen) and chosen >= 0):
        raise InputError(
            "not a sample time", where="--sample-time", expected="seconds >= 0", got=repr(chosen)
        )
    wanted = 2 if form == "vehicle" else m
    fits = len(bounds) == wanted or (form != "vehicle" and not bounds)
    if not fits or not all(math.isfinite(value) and value >= 0 for value in bounds):
        raise InputError(
            "the limits do not fit the controller",
            where="--limits",
            expected="largest thrust [N] and largest moment [N m]"
            if form == "vehicle"
            else f"{counted(m, 'number')} >= 0, one per command",
            got=", ".join(map(repr, bounds)),
        )
    return {"sample_time": chosen, "limits": bounds}
