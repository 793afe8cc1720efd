"""The design problem of a scenario, and its gain as parameters of the controller's FMU."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from cosim import hinf
from cosim.core import PLANT_NOTE, InputError, NotAchievableError
from cosim.fmu import FmuDescription
from cosim.fmu.inspect import certified_values
from cosim.models import Delay, DelaySystem
from cosim.scenario.age_claim import feedback_of
from cosim.scenario.designed_plant import DesignedPlant
from cosim.scenario.feedback_age import FeedbackAge
from cosim.scenario.plant import NO_PARAMETERS, design_settings_for
from cosim.scenario.schema import ComponentPart, DesignPart

if TYPE_CHECKING:
    from cosim.hinf import Result

_AUV_ONLY = ("state_delay", "loop_delay", "damping", "position_weight", "envelope")


@dataclass(frozen=True)
class Problem:
    """A design problem.

    system, k1, k2 : k1 and k2 None where they are to be searched.
    vehicle : settings that the system was made from, if it is the vehicle.
    design_constraints : what the gain must meet beside gamma.
    plant : how the plant of the run is seen as the system, where the design knows.
    """

    system: DelaySystem
    k1: tuple[float, ...] | None
    k2: tuple[float, ...] | None
    vehicle: hinf.problem.AuvDesignSettings | None
    design_constraints: hinf.DesignConstraints = field(
        default_factory=lambda: hinf.DesignConstraints()  # noqa: PLW0108 - loaded when it is made
    )
    plant: DesignedPlant | None = None


def problem_of(
    part: DesignPart, folder: Path, plant: Mapping[str, float] = NO_PARAMETERS
) -> Problem:
    """Return the problem that [design] describes; the file of a system is relative to `folder`.

    plant : parameters of the vehicle that flies (`parameters_of_plant`), for the system `auv`.

    Raises
    ------
    InputError : no such system, or keys that it does not have.
    """
    found = _problem_of(part, folder, plant)
    return replace(found, system=_with_age(found.system, part))


def _problem_of(part: DesignPart, folder: Path, plant: Mapping[str, float]) -> Problem:
    """Return the problem before what [design] says of the age of the feedback."""
    system = str(part.system)
    if system == "auv":
        return _auv_problem(part, plant)
    _refuse_vehicle_keys(part, f"system = {part.system!r}")
    if is_file(part):
        named = hinf.system_by_name(str(folder / system))
    elif system in hinf.problem.BUILT_IN_SYSTEMS:
        named = hinf.system_by_name(system)
    else:
        wrong = hinf.problem.unknown_system(system, "design.system")
        if system.endswith(".json"):
            wrong.hint = f'a design is named by another key: file = "{system}"'
        raise wrong
    k1 = named.k1 if part.k1 is None else tuple(part.k1)
    k2 = named.k2 if part.k2 is None else tuple(part.k2)
    return Problem(named.system, k1, k2, None, named.design_constraints)


def observes(found: Result | None) -> TypeGuard[Result]:
    """Whether a design feeds back what an observer estimates, rather than the measured state."""
    return found is not None and found.observer is not None


def problem_about(
    part: DesignPart,
    found: Result,
    where: str,
    folder: Path | None,
    plant: Mapping[str, float] = NO_PARAMETERS,
) -> Problem:
    """Return the problem of an existing design, which must be the one [design] describes.

    Without a system in [design], that of the design counts; with a `file` its delays count too,
    unless [design] has them.

    Parameters
    ----------
    where : the design, for messages.
    folder : start of the path of a system's file; None: do not read that file.
    plant : parameters of the vehicle that flies. The design may be for them, or for Table 1.

    Raises
    ------
    InputError : [design] describes another system, or one that does not exist.
    """
    if observes(found):
        return _output_feedback_problem(part, found, where)
    require_up_to(found)
    own = Problem(found.system, found.k1, found.k2, None)
    named = found.system.name if part.system is None else part.system
    if (part.system is None and named not in hinf.problem.BUILT_IN_SYSTEMS) or (
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
    differs = None
    for parameters in (plant, NO_PARAMETERS) if plant else (NO_PARAMETERS,):
        described = problem_of(part.model_copy(update=known), folder or Path(), parameters)
        if not _says_age(part):  # the design knows it: from its own file, or from the links
            like = next((d for d in found.system.delays if d.feedback), None)
            described = replace(described, system=like_feedback(described.system, like))
        differs = hinf.certificate.first_difference(described.system, found.system)
        if differs is None:
            break
    if differs is not None:
        raise InputError(
            "this design is for another system than [design] describes",
            where=where,
            expected=f"the system {named!r} as [design] describes it",
            got=differs,
            hint="leave out system and what else describes it: the design knows its own; or "
            "leave out file, and a new gain is designed",
        )
    return replace(own, vehicle=described.vehicle)


def _output_feedback_problem(part: DesignPart, found: hinf.Result, where: str) -> Problem:
    """Return the problem of a design with an observer, which knows its system and its plant."""
    known = {"file", "controller", "plant"}
    given = sorted(key for key in part.model_fields_set - known if getattr(part, key) is not None)
    if given:
        raise InputError(
            f"{', '.join(given)} beside the design of an observer",
            where=where,
            expected="file, controller and plant: the design knows its system and its ages",
            hint="leave them out",
        )
    note = found.certificate.get(PLANT_NOTE)
    plant = None if note is None else DesignedPlant.from_json(note, f"{where}: {PLANT_NOTE}")
    return Problem(found.system, None, None, None, plant=plant)


def _refuse_vehicle_keys(part: DesignPart, got: str) -> None:
    given = [key for key in _AUV_ONLY if getattr(part, key) is not None]
    if given:
        raise InputError(f"{', '.join(given)} belong to the system 'auv'", where="design", got=got)


_AGE_KEYS = ("least_age", "rate", "sampled")


def _says_age(part: DesignPart) -> bool:
    return any(getattr(part, key) is not None for key in _AGE_KEYS)


def _with_age(system: DelaySystem, part: DesignPart) -> DelaySystem:
    """Return the system with what [design] says of the age of the feedback."""
    given = {key: value for key in _AGE_KEYS if (value := getattr(part, key)) is not None}
    if not given:
        return system
    if not any(delay.feedback and delay.d > 0 for delay in system.delays):
        raise InputError(
            "the feedback of this system has no age",
            where=f"design.{next(iter(given))}",
            expected="a system with feedback over a delay",
            got=f"{system.name}, u = K x(t)",
        )
    try:
        delays = [replace(x, **given) if x.feedback else x for x in system.delays]
    except ValueError as error:
        raise InputError(str(error), where=f"design.{next(iter(given))}") from error
    return replace(system, delays=tuple(delays))


def like_feedback(system: DelaySystem, like: Delay | None) -> DelaySystem:
    """Return the system with as much known of the age of its feedback as of `like`.

    Where that does not go with its own delay, and without `like`, the system as it is.
    """
    if like is None or not like.ages_are_known:
        return system
    kinds: dict[str, Any] = {
        "least_age": like.least_age,
        "rate": like.rate,
        "sampled": like.sampled,
    }
    delays = [
        replace(x, **kinds) if x.feedback and x.any_age and x.d > like.least_age else x
        for x in system.delays
    ]
    return replace(system, delays=tuple(delays))


def require_up_to(found: hinf.Result) -> None:
    """Refuse a design for ages that no run has (NotAchievableError).

    That is exactly one measurement age, and an age that changes at a bounded rate.
    """
    _refuse_rate(found.system)
    if found.covers_smaller_delays:
        return
    # constant ones in the plant are parameters of it, which the run compares with the design
    if any(x["feedback"] for x in _exact(found)):
        raise NotAchievableError(
            "at this order the proof is about exactly one age of the measurements",
            where="design.order",
            expected="one that covers every age up to it: the age of a message varies",
            got=str(found.order),
            hint="order = 0 covers them, and so does a delay of any age",
        )


def _exact(found: hinf.Result) -> list[dict[str, Any]]:
    """Return what the claim says of delays that it covers at exactly one value."""
    return [
        x
        for x in found.certificate["claim"]["delays"]
        if x["age"] == hinf.certificate.AgeWord.EXACTLY
    ]


def _refuse_rate(system: DelaySystem) -> None:
    """Refuse a bounded rate of the age of the feedback (NotAchievableError)."""
    if any(delay.feedback and delay.rate is not None for delay in system.delays):
        raise NotAchievableError(
            "the age of the feedback has no bounded rate in a run",
            where="design.rate",
            expected="any age, one from least_age on, or a sampled one",
            got="held values: their age grows at rate one, and falls when a newer one comes",
            hint="sampled = true, where the links justify it",
        )


def is_file(part: DesignPart) -> bool:
    """Whether [design] names its system by a file, which a trace does not contain."""
    return part.system is not None and part.system.endswith(".toml")


def _auv_problem(part: DesignPart, plant: Mapping[str, float]) -> Problem:
    given = {key: value for key in _AUV_ONLY if (value := getattr(part, key)) is not None}
    if part.damping is not None:
        given["damping"] = tuple(part.damping)
    if part.envelope is not None:
        given["envelope"] = hinf.problem.Envelope(**part.envelope.model_dump())
    vehicle = design_settings_for(hinf.problem.AuvDesignSettings(**given), given, plant)
    system = hinf.auv_system(vehicle)
    n = len(system.delays)
    k1 = hinf.problem.DEFAULT_K1[:n] if part.k1 is None else tuple(part.k1)
    k2 = hinf.problem.DEFAULT_K2[:n] if part.k2 is None else tuple(part.k2)
    return Problem(system, k1, k2, vehicle)


def solve(
    problem: Problem, gain: Sequence[Sequence[float]] | None, order: int | None = None
) -> hinf.Result:
    """Design a gain, or analyse the given one.

    Raises
    ------
    NotAchievableError : nothing could be certified, or only for exactly one age.
    """
    _refuse_rate(problem.system)
    design_constraints = asdict(problem.design_constraints)
    found = hinf.design(
        problem.system,
        problem.k1,
        problem.k2,
        gain=gain,
        order="auto" if order is None else order,
        **design_constraints,
    )
    if (
        order is None
        and not found.covers_smaller_delays
        and not hinf.problem.ages_are_known(problem.system)
    ):
        # ages in a run are rarely one number: Theorem 2 covers all up to it
        found = hinf.design(
            problem.system, problem.k1, problem.k2, gain=gain, order=None, **design_constraints
        )
    require_up_to(found)
    return found


def with_known_age(problem: Problem, known: FeedbackAge | None) -> Problem:
    """Return the problem with the sharpest kind of age of its feedback that `known` justifies.

    The problem itself where that is no more than it says: feedback of any age, up to a bound.
    """
    late = feedback_of(problem.system)
    if late is None or known is None or not late.any_age or late.ages_are_known:
        return problem
    least = known.least_ns / 1e9
    if not 0 < least < late.d or problem.design_constraints.any:
        return problem
    like = replace(late, least_age=least, sampled=known.sampled)
    return replace(problem, system=like_feedback(problem.system, like))


def solve_sharply(problem: Problem, linked: Problem, part: DesignPart) -> hinf.Result:
    """Design for `problem`, and prove the gain for `linked`, the same with a better known age.

    The better proof is claimed. Where nothing can be proved for `problem`, design for `linked`.

    Raises
    ------
    NotAchievableError : as `solve`.
    """
    try:
        found = solve(problem, part.gain, part.order)
    except NotAchievableError:
        if linked is problem:
            raise
        return solve(linked, part.gain, part.order)
    if linked is problem or found.gamma is None or part.order is not None:
        return found
    try:
        better = hinf.synthesis.quickly_proved(linked.system, found.K)
        if better is None:
            return found
        require_up_to(better)
    except NotAchievableError:
        return found
    return better if better.gamma is not None and better.gamma < found.gamma else found


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


def controller_parameters(found: Result, controller: FmuDescription) -> dict[str, float]:
    """Return a design as parameters of the FMU that is to fly it.

    Raises
    ------
    InputError : it is a controller for another design.
    """
    if not observes(found):
        return gain_parameters(found.K, controller)
    values = certified_values(found.certificate)
    unlike = [name for name in values if name not in controller.ports]
    if unlike:
        raise InputError(
            "the design does not fit the controller",
            where=str(controller.path),
            expected=f"parameters {', '.join(unlike[:4])}{' ...' if len(unlike) > 4 else ''}",
            got=f"an FMU with {', '.join(list(controller.ports)[:4])} ...",
            hint="cosim fmu controller packs a design as its controller",
        )
    return values


def require_own_numbers(found: Result, controller: FmuDescription, part: ComponentPart) -> None:
    """Refuse numbers of a controller beside a design that has others.

    Raises
    ------
    InputError : names the first one, with both values.
    """
    for name, designed in controller_parameters(found, controller).items():
        given = part.parameters.get(name)
        if given is not None and given != designed:
            raise InputError(
                f"{name} is a number of the design, and the scenario has another one",
                where=name,
                expected=f"{designed!r}, as in the design, or nothing",
                got=f"{given!r}",
                hint="leave it out; or leave out [design], and nothing is guaranteed",
            )


def starts_with(found: Result, controller: FmuDescription) -> bool:
    """Whether a controller FMU starts with the numbers of a design."""
    return all(
        controller.ports[name].start == value
        for name, value in controller_parameters(found, controller).items()
    )
