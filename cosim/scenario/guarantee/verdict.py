"""What the guarantee of a design assumes of a run, and why it was not met where it was not.

One list, made of the claim: the loop that flew is the loop as designed (`wiring`, `parameters`),
what was recorded obeys its law (`law_measures`), its ages are those of the claim (`ages`), the
state stayed in the envelope, no command stood at its limit, and nothing in the loop was set. All
views, reports and studies read this list and nothing else.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim import hinf
from cosim.master import System
from cosim.scenario.gain import Problem, observes
from cosim.scenario.guarantee.ages import (
    FedBack,
    Findings,
    command_findings,
    feedback_findings,
    findings_of_all,
    measurement_findings,
)
from cosim.scenario.guarantee.claim import feedback_words, unknown_words
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop
from cosim.scenario.guarantee.parameters import (
    controller_differences,
    plant_differences,
    sensor_departures,
)
from cosim.scenario.guarantee.wiring import Wiring

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.scenario.age import MeasuredAges
    from cosim.scenario.designed_plant import Difference

_HUGE = 1e300


@dataclass(frozen=True)
class LoopOfRun:
    """The loop of a run beside that of its design, before it flies.

    Attributes
    ----------
    loop : as designed.
    wiring : of the run.
    departures : where the connections are not those of the design.
    differences : by component the parameters that are not.
    sensors : errors of sensors that the design does not count with.
    """

    loop: DesignedLoop
    wiring: Wiring
    departures: list[Departure]
    differences: Mapping[str, list[Difference]]
    sensors: list[Departure]


@dataclass(frozen=True)
class MeasuredRun:
    """What a verdict needs of the rows of a run.

    Attributes
    ----------
    laws : by assumption where the run, or its zero-state run, left its law.
    ages : of the feedback by place; of an observer's measurements by name.
    command_age_ns : of an observer.
    commands_known : whether the observer took what acted to act; None without one.
    substituted : a link used a substitute.
    envelope_use : by axis, the greatest share; None without an envelope.
    limits_reached : a command stood at its limit; None without limits.
    altered : what events changed but the traffic of links.
    """

    laws: Mapping[str, list[Departure]] = field(default_factory=dict)
    ages: Mapping[str, MeasuredAges | None] = field(default_factory=dict)
    command_age_ns: int | None = None
    commands_known: bool | None = None
    substituted: bool = False
    envelope_use: Mapping[str, float] | None = None
    limits_reached: bool | None = None
    altered: Iterable[str] = ()


def loop_of_run(
    system: System, loop: DesignedLoop, design: Result, problem: Problem, maps: Mapping[str, Any]
) -> LoopOfRun:
    """Compare a system with the loop of its design.

    Parameters
    ----------
    maps : the components that are linear maps (`Lowered.maps`).
    """
    wiring = Wiring(system, loop, maps)
    departures = wiring.departures()
    plant, controller = (system.components[name] for name in (loop.plant, loop.controller))
    return LoopOfRun(
        loop,
        wiring,
        departures,
        {
            loop.plant: plant_differences(design, problem, plant),
            loop.controller: controller_differences(design, problem, controller),
        },
        list(sensor_departures(system, wiring.sensors)),
    )


def fed_back(design: hinf.Result, loop: DesignedLoop) -> list[tuple[FedBack, tuple[str, ...]]]:
    """Return the ages of a state feedback, each with the inputs of the controller that have it."""
    system, names = design.system, tuple(loop.states)
    measured = [j for j, own in enumerate(system.measured) if own][: len(names)]
    words = {id(delay): word for delay, word in feedback_words(design)}
    found = []
    for delay, mask in zip((None, *system.delays), system.selections, strict=True):
        if not mask.any():
            continue
        of_states = np.asarray(np.any(np.atleast_2d(mask), axis=0))
        own = tuple(name for name, j in zip(names, measured, strict=True) if of_states[j])
        d = 0.0 if delay is None else delay.d
        word = "at once" if delay is None else words.get(id(delay), "")
        if mask.ndim == 2 and not (mask == mask[:1]).all():
            word = "by entry of K"
        least = 0.0 if delay is None else delay.least_age
        place = "the feedback" if len(own) == len(names) else ", ".join(own) or "the integrals"
        found.append((FedBack(place, d, least, word), own))
    return found


def findings_of(
    design: Result, compared: LoopOfRun, run: MeasuredRun, proved_again: str
) -> Findings:
    """Return every assumption of the guarantee, with why it was not met; empty where it was.

    Parameters
    ----------
    proved_again : what to say where a proof is about a constant age.
    """
    found: Findings = {"certificate_verified": list(_verified(design))}
    found["loop_as_designed"] = list(compared.departures)
    found["plant_as_designed"] = _differ(compared, compared.loop.plant)
    found["controller_as_designed"] = _differ(compared, compared.loop.controller)
    if observes(design):
        found["sensors_as_designed"] = list(compared.sensors)
        n = len(design.system.A)
        for one in design.measurements:
            found |= measurement_findings(
                one.delay(n),
                one.name,
                run.ages.get(one.name),
                proved_again,
                substituted=run.substituted,
            )
        found |= command_findings(design.pair, run.command_age_ns, proved_again)
        if run.commands_known is not True:
            expected = "what the observer takes to act"
            got = "something else" if run.commands_known is False else "not known"
            found["observer_knows_commands"] = [Departure(compared.loop.plant, expected, got)]
        else:
            found["observer_knows_commands"] = []
    else:
        found |= findings_of_all(
            {
                age.place: feedback_findings(
                    age,
                    run.ages.get(age.place),
                    proved_again,
                    substituted=run.substituted,
                )
                for age, _ in fed_back(design, compared.loop)
            }
        )
    for name, departures in run.laws.items():
        found[name] = list(departures)
    if run.envelope_use is not None:
        found["state_inside_envelope"] = list(_outside(run.envelope_use))
    if run.limits_reached is not None:
        words = Departure(compared.loop.controller, "no command at its limit", "one was")
        found["limits_not_reached"] = [words] if run.limits_reached else []
    found["nothing_set_or_overridden"] = list(_set(compared.wiring, run.altered))
    unknown = unknown_words(design)
    if unknown:
        expected = "words of a claim that are known"
        found["claim_known"] = [Departure("certificate", expected, x) for x in unknown]
    return found


def _verified(design: Result) -> Iterator[Departure]:
    """Yield why the proof does not hold; checked once per design, even in a study of many runs."""
    if not design.certified:
        reason = hinf.check_certificate(design.certificate).reason
        yield Departure("certificate", "a proof that holds", str(reason))


def _differ(compared: LoopOfRun, component: str) -> list[Departure]:
    return [
        Departure(
            f"{component}.{one.parameter}",
            repr(one.designed),
            "absent" if one.value is None else repr(one.value),
        )
        for one in compared.differences[component]
    ]


def _outside(use: Mapping[str, float]) -> Iterator[Departure]:
    for axis, share in use.items():
        if not share <= 1.0:
            got = f"{100 * share:.4g} %" if share < _HUGE else "beyond all numbers"
            yield Departure(axis, "at most 100 % of its bound in the envelope", got)


def _set(wiring: Wiring, altered: Iterable[str]) -> Iterator[Departure]:
    """Yield what events have changed in the loop; its set-points and disturbances are free."""
    for place in altered:
        component, _, variable = place.partition(".")
        if component not in wiring.components() or (variable and wiring.is_free(place)):
            continue
        yield Departure(place, "as designed, for the whole run", "set or overridden by an event")
