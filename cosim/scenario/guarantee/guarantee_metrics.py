"""The guarantee among the metrics of a run: every assumption, what was not met and where, facts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cosim import hinf
from cosim.scenario.guarantee.ages import Findings, of_commands
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.facts import facts_of_run
from cosim.scenario.guarantee.law_measures import MeasuredLaw
from cosim.scenario.guarantee.verdict import MeasuredRun, findings_of

if TYPE_CHECKING:
    from cosim.hinf import Result
    from cosim.scenario.run_context import RunContext


def guarantee_metrics(context: RunContext) -> dict[str, Any]:
    """Return whether each assumption was met, and by name and place what was not as designed."""
    found = _findings(context)
    named: dict[str, Any] = {"assumptions": {name: not each for name, each in found.items()}}
    if found:
        named["guarantee_claimed"] = not any(found.values())
    if departures := [
        {"assumption": name, **one.to_json()} for name, each in found.items() for one in each
    ]:
        named["departures"] = departures
    if context.compared is not None and found:
        apart = [
            {"parameter": f"{component}.{x.parameter}", "value": x.value, "designed": x.designed}
            for component, different in context.compared.differences.items()
            for x in different
        ]
        if apart:  # the numbers of some of the departures
            named["plant_differences"] = apart
    return named | _facts(context)


def _facts(context: RunContext) -> dict[str, Any]:
    """Return the facts under the verdict, and how the state grew where nothing drove it."""
    design, problem, compared = context.design, context.problem, context.compared
    law = context.laws.get("run")
    if design is None or problem is None or compared is None or law is None:
        return {}
    at_rest = context.laws.get("zero-state run", law)
    beside, share = context.zero_state, None
    if beside is not None and beside.energy and at_rest.noise_energy is not None:
        share = at_rest.noise_energy / beside.energy
    disturbed = beside is None or beside.energy != 0.0 or bool(context.altered)
    facts = facts_of_run(
        *(design, problem, context.system, compared.wiring, law.motion, context.gain, share),
        disturbed=disturbed,
    )
    found: dict[str, Any] = {"facts": [fact.to_json() for fact in facts], "disturbed": disturbed}
    if law.motion is not None and not law.motion.driven and not context.altered:
        found["state_growth"] = law.motion.growth
    return found


def _findings(context: RunContext) -> Findings:
    """Return every assumption of the guarantee, with why it was not met; empty without one."""
    design, compared = context.design, context.compared
    if design is None or compared is None:
        return {}
    figures, beside = context.figures, context.zero_state
    ages = dict(figures.stamped_ages or figures.ages_by_place)
    if figures.stamped_ages is None and not ages:
        ages = {"the feedback": figures.ages}
    step = context.system.comm_schedule.step_ns
    ages["the integrals"] = of_commands(figures.command_age_ns, step)
    of_runs = (figures.saturation, None if beside is None else beside.saturation)
    reached = [one.fraction != 0.0 for one in of_runs if one is not None]
    measured = MeasuredRun(
        laws=_left(context.laws),
        ages=ages,
        command_age_ns=figures.command_age_ns,
        commands_known=figures.commands_known,
        substituted=any(link["substitutions"] for link in context.links.values()),
        envelope_use=context.envelope_use,
        limits_reached=any(reached) if figures.saturation is not None else None,
        altered=context.altered,
    )
    return findings_of(design, compared, measured, _proved_again(context, design))


def _proved_again(context: RunContext, design: Result) -> str:
    """Return what proves a design of constant ages for those that a run has."""
    part, ages = context.scenario.design, context.figures.ages
    where = part.file if part is not None and part.file else f"{context.scenario.title}.design.json"
    oldest_ns = max(context.figures.command_age_ns or 0, 0 if ages is None else ages.greatest_ns)
    command = hinf.certificate.reproving_command(
        design.certificate, where, hold=oldest_ns / 1e9 or None
    )
    return "" if command is None else f"proved anew by: {command}"


def _left(laws: Mapping[str, MeasuredLaw]) -> dict[str, list[Departure]]:
    """Return by assumption where runs left their law."""
    found: dict[str, list[Departure]] = {}
    for run, law in laws.items():
        for name, departures in law.departures.items():
            named = departures
            if run != "run":
                named = [one._replace(got=f"{one.got}, in the {run}") for one in departures]
            found.setdefault(name, []).extend(named)
    return found
