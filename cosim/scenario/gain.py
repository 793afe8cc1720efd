"""The design problem of a scenario, and its gain as parameters of the controller's FMU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import InputError, NotAchievableError
from cosim.fmu import FmuDescription
from cosim.hinf import (
    BUILT_IN_SYSTEMS,
    DEFAULT_K1,
    DEFAULT_K2,
    AuvDesignSettings,
    Design,
    DesignConstraints,
    Envelope,
    auv_system,
    design,
    first_difference,
    system_by_name,
)
from cosim.models import DelaySystem
from cosim.scenario.schema import DesignPart

_AUV_ONLY = ("state_delay", "loop_delay", "damping", "position_weight", "envelope")


@dataclass(frozen=True)
class Problem:
    """A design problem.

    system, k1, k2 : k1 and k2 None where they are to be searched.
    vehicle : settings that the system was made from, if it is the vehicle.
    design_constraints : what the gain must meet beside gamma.
    """

    system: DelaySystem
    k1: tuple[float, ...] | None
    k2: tuple[float, ...] | None
    vehicle: AuvDesignSettings | None
    design_constraints: DesignConstraints = field(default_factory=DesignConstraints)


def problem_of(part: DesignPart, folder: Path) -> Problem:
    """Return the problem that [design] describes; the file of a system is relative to `folder`.

    Raises
    ------
    InputError : no such system, or keys that it does not have.
    """
    system = str(part.system)
    if system == "auv":
        return _auv_problem(part)
    _refuse_vehicle_keys(part, f"system = {part.system!r}")
    if is_file(part):
        named = system_by_name(str(folder / system))
    elif system in BUILT_IN_SYSTEMS:
        named = system_by_name(system)
    else:
        known = (*BUILT_IN_SYSTEMS, "FILE.toml")
        raise InputError.unknown("system", system, known, where="design.system")
    k1 = named.k1 if part.k1 is None else tuple(part.k1)
    k2 = named.k2 if part.k2 is None else tuple(part.k2)
    return Problem(named.system, k1, k2, None, named.design_constraints)


def problem_about(part: DesignPart, found: Design, where: str, folder: Path | None) -> Problem:
    """Return the problem of an existing design, which must be the one [design] describes.

    Without a system in [design], that of the design counts; with a `file` its delays count too,
    unless [design] has them.

    Parameters
    ----------
    where : the design, for messages.
    folder : start of the path of a system's file; None: do not read that file.

    Raises
    ------
    InputError : [design] describes another system, or one that does not exist.
    """
    require_up_to(found)
    own = Problem(found.system, found.k1, found.k2, None)
    named = found.system.name if part.system is None else part.system
    if (part.system is None and named not in BUILT_IN_SYSTEMS) or (
        folder is None and is_file(part)
    ):
        _refuse_vehicle_keys(part, where)
        return own
    known: dict[str, Any] = {"system": named}
    if part.file is not None and named == "auv":
        late = {delay.feedback: delay.d for delay in found.system.delays}
        known["loop_delay"] = late.get(True, 0.0) if part.loop_delay is None else part.loop_delay
        if part.state_delay is None:
            known["state_delay"] = late.get(False)
    described = problem_of(part.model_copy(update=known), folder or Path())
    differs = first_difference(described.system, found.system)
    if differs is not None:
        raise InputError(
            "this design is for another system than [design] describes",
            where=where,
            expected=f"the system {named!r} as [design] describes it",
            got=differs,
            hint="say in [design] what it was made for, leave that out, or leave out file",
        )
    return replace(own, vehicle=described.vehicle)


def _refuse_vehicle_keys(part: DesignPart, got: str) -> None:
    given = [key for key in _AUV_ONLY if getattr(part, key) is not None]
    if given:
        raise InputError(f"{', '.join(given)} belong to the system 'auv'", where="design", got=got)


def require_up_to(found: Design) -> None:
    """Refuse a design that is proved for exactly one measurement age (NotAchievableError)."""
    if not found.covers_smaller_delays:
        raise NotAchievableError(
            "at this order the proof is about exactly one age of the measurements",
            where="design.order",
            expected="one that covers every age up to it: the age of a message varies",
            got=str(found.order),
            hint="order = 0 covers them, and so does a delay of any age",
        )


def is_file(part: DesignPart) -> bool:
    """Whether [design] names its system by a file, which a trace does not contain."""
    return part.system is not None and part.system.endswith(".toml")


def _auv_problem(part: DesignPart) -> Problem:
    given = {key: value for key in _AUV_ONLY if (value := getattr(part, key)) is not None}
    if part.damping is not None:
        given["damping"] = tuple(part.damping)
    if part.envelope is not None:
        given["envelope"] = Envelope(**part.envelope.model_dump())
    vehicle = AuvDesignSettings(**given)
    system = auv_system(vehicle)
    n = len(system.delays)
    k1 = DEFAULT_K1[:n] if part.k1 is None else tuple(part.k1)
    k2 = DEFAULT_K2[:n] if part.k2 is None else tuple(part.k2)
    return Problem(system, k1, k2, vehicle)


def solve(
    problem: Problem, gain: Sequence[Sequence[float]] | None, order: int | None = None
) -> Design:
    """Design a gain, or analyse the given one.

    Raises
    ------
    NotAchievableError : nothing could be certified, or only for exactly one age.
    """
    design_constraints = asdict(problem.design_constraints)
    found = design(
        problem.system,
        problem.k1,
        problem.k2,
        gain=gain,
        order="auto" if order is None else order,
        **design_constraints,
    )
    if order is None and not found.covers_smaller_delays:
        # ages in a run are rarely one number: Theorem 2 covers all up to it
        found = design(problem.system, problem.k1, problem.k2, gain=gain, order=None)
    require_up_to(found)
    return found


def gain_parameters(K: Any, controller: FmuDescription) -> dict[str, float]:
    """Return K as the parameters `K[i,j]` of a controller FMU.

    Raises
    ------
    InputError : the FMU has another number of entries.
    """
    rows = np.asarray(K, dtype=float)
    values = {f"K[{i + 1},{j + 1}]": float(v) for (i, j), v in np.ndenumerate(rows)}
    own = {name for name in controller.ports if name.startswith("K[")}
    if own != set(values):
        raise InputError(
            "the gain does not fit the controller",
            where=str(controller.path),
            expected=f"{rows.shape[0]} x {rows.shape[1]} parameters K[i,j]",
            got=f"{len(own)}: {', '.join(sorted(own)[:4])} ...",
        )
    return values


def starts_with(K: Any, controller: FmuDescription) -> bool:
    """Whether a controller FMU starts with the gain K."""
    return all(
        controller.ports[name].start == value
        for name, value in gain_parameters(K, controller).items()
    )
