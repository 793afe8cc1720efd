"""Designs, analyses and exported FMUs, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim import hinf
from cosim.cli.terminal import facts_table, number
from cosim.core import at_least, at_most

if TYPE_CHECKING:  # `cosim fmu check` needs neither
    from cosim.fmu import ControllerFmu, PlantFmu
    from cosim.models import Delay, DelaySystem
    from cosim.vehicle import VehicleFmu

_LIMIT_REACHED = "certified; the search ended here, longer delays may be certified too"


def design_view(
    name: str,
    design: hinf.Design,
    greatest: hinf.GreatestDelay | None = None,
    nominal: float | None = None,
    remark: str | None = None,
) -> RenderableType:
    """Show a design: what is proved, what is computed, the gain, and a remark on its size."""
    facts = facts_table()
    gamma = "stability only" if design.gamma is None else at_most(design.gamma)
    facts.add_row("gamma", gamma, "certified: exact rational proof for the gain below")
    if nominal is not None and design.gamma is not None:
        facts.add_row(
            "  without uncertainty",
            at_most(nominal),
            f"certified, same gain and condition: E and H account for {design.gamma - nominal:.3g}",
        )
    _nominal_rows(facts, design)
    if design.order is not None:
        facts.add_row("condition", condition_of(design.certificate["claim"]), "")
    for row in _guarantees(design.guarantees):
        facts.add_row(*row)
    _feedback_rows(facts, design.system)
    for i, delay in enumerate(design.system.delays):
        scalars = f"; k1 = {design.k1[i]:g}, k2 = {design.k2[i]:g}" if design.k2 else ""
        facts.add_row(
            f"delay {i + 1}",
            f"{delay.d:g} s",
            _age(delay, design) + scalars,
        )
    if greatest is not None:
        facts.add_row("greatest delay", f"{at_least(greatest.delay)} s", _end(greatest))
    gain = Table(title=f"K ({name}): u = K x", title_justify="left", show_header=False, box=None)
    for row in design.K:
        gain.add_row(*(f"{value:.4g}" for value in row))
    remarks = [
        x for x in (remark, hinf.certificate.remark_on_ages(design.certificate)) if x is not None
    ]
    lines = [Text.assemble(("remark", "bold yellow"), f": {text}") for text in remarks]
    return Group(facts, gain, *lines)


def _guarantees(more: hinf.certificate.Guarantees) -> list[tuple[str, str, str]]:
    """Return rows for what is proved beside gamma: (figure, value, explanation)."""
    rows = []
    if more.decay is not None:
        text = "certified: with w = 0 every solution decays at least as exp(-rate t)"
        rows.append(("rate of decay", f"{at_least(str(more.decay.rate))} 1/s", text))
    if more.damping is not None:
        within = at_least(str(more.damping.within))
        text = f"certified: of every root of the nominal loop with Re s >= -{within} 1/s"
        rows.append(("damping ratio", at_least(str(more.damping.ratio)), text))
    if more.gain_limit is not None:
        rows.append(("|K|", at_most(str(more.gain_limit.bound)), "certified: at most this"))
    if more.outages is not None:
        own = more.outages
        rates = f"V falls at 2 x {at_least(str(own.alpha))} 1/s in touch"
        text = f"{rates}, grows at most at 2 x {at_most(str(own.beta))} 1/s out of touch, u = 0"
        rows.append(
            ("time in touch needed", f"{at_most(str(100 * own.share), 4)} %", f"certified: {text}")
        )
        if own.gamma is not None:
            text = "certified: weighted with V's rates, across any outages"
            rows.append(("gain across outages", at_most(str(own.gamma)), text))
    if more.peak_control is not None:
        peak = more.peak_control
        start = ", ".join(at_least(str(x)) for x in peak.offset)
        text = f"certified: |u_{{}}(t)| at most this, from |x| <= ({start})"
        if peak.energy != 0:
            text += f", with (int w'w)^(1/2) <= {at_least(str(peak.energy))}"
        rows += [
            (f"peak of u_{i}", at_most(str(bound)), text.format(i))
            for i, bound in enumerate(peak.bounds, 1)
        ]
    return rows


def analysis_view(
    name: str, analysis: hinf.Analysis, greatest: hinf.synthesis.CertifiedDelay | None = None
) -> RenderableType:
    """Show an analysis: what is proved, or why nothing is, and what is computed."""
    what = f"{name}, u = 0" if analysis.K is None else f"{name}, u = K x"
    if analysis.certified:
        head = Text.assemble(("certified", "bold green"), f": {what}")
    else:
        head = Text.assemble(
            (f"not certified, {analysis.verdict}", "bold yellow"), f": {what}\n  {analysis.reason}"
        )
    facts = facts_table()
    proof = analysis.certificate or {"claim": {"property": "", "order": analysis.order}}
    facts.add_row("condition", condition_of(proof["claim"]), "")
    if analysis.certified:
        gamma = "stability only" if analysis.gamma is None else at_most(analysis.gamma)
        facts.add_row("gamma", gamma, "certified: exact rational proof for this gain")
    for row in _guarantees(analysis.guarantees):
        facts.add_row(*row)
    if analysis.damping_reason is not None:
        facts.add_row("damping ratio", "not proved", analysis.damping_reason)
    _nominal_rows(facts, analysis)
    for i, delay in enumerate(analysis.system.delays):
        facts.add_row(
            f"delay {i + 1}",
            f"{delay.d:g} s",
            _age(delay, analysis),
        )
    if greatest is not None and greatest.d is not None:
        end = _LIMIT_REACHED
        if greatest.not_certified_at is not None:
            end = f"certified; not certified at {at_most(greatest.not_certified_at)} s"
        facts.add_row("greatest delay", f"{at_least(greatest.d)} s", end)
    return Group(head, facts)


def _age(delay: Delay, found: hinf.Design | hinf.Analysis) -> str:
    """Say which ages a proof covers, or was looked for."""
    if not delay.any_age:
        kind = "any constant up to this" if found.covers_smaller_delays else "exactly this constant"
    elif found.certificate is None or "hypotheses" not in found.certificate["claim"]:
        kind = "any age up to this"
    else:
        span = f"from {delay.least_age:g} s to this" if delay.least_age > 0 else "up to this"
        if delay.sampled:
            kind = f"sampled: grows at rate one, {span}"
        elif delay.rate is not None:
            kind = f"any age {span}, rate at most {delay.rate:g}"
        else:
            kind = f"any age {span}"
    return kind + acts_of(delay.feedback)


def acts_of(feedback: Any) -> str:
    """Say what acts through a delay."""
    if isinstance(feedback, bool):
        return ", the control acts through this delay" if feedback else ""
    return f", {states_text(feedback)} fed back through this delay"


def states_text(chosen: Any) -> str:
    """List states by their numbers; of rows of truth values, those of any row."""
    rows = chosen if isinstance(chosen[0], Sequence) else [chosen]
    numbers = [str(j) for j, own in enumerate(zip(*rows, strict=True), 1) if any(own)]
    return f"state{'s' * (len(numbers) > 1)} {', '.join(numbers)}"


def _feedback_rows(facts: Table, system: DelaySystem) -> None:
    """Add what is fed back, where that is not the whole state alike."""
    if not system.is_structured:
        return
    if system.feedback is not None and any(system.feedback):
        facts.add_row("feedback", states_text(system.feedback), "at once")
    lost = [not own for own in system.measured]
    if any(lost):
        facts.add_row("not measured", states_text(lost), "K is zero there")
    if system.integrals:
        n = len(system.A)
        last = [j >= n - system.integrals for j in range(n)]
        facts.add_row("integrals", states_text(last), "kept by the controller; outputs z too")


def _nominal_rows(facts: Table, found: hinf.Design | hinf.Analysis) -> None:
    """Add the figures of the nominal loop, with all delays constant."""
    norm, upper = found.exact_norm, found.exact_norm_upper
    if norm is not None:
        peak = found.norm_frequency
        at = "infinite frequency" if peak is None else f"{peak:.4g} rad/s"
        ratio = (
            "" if found.gamma is None or not norm else f"; gamma is {found.gamma / norm:.4g} of it"
        )
        facts.add_row("exact norm", f"{norm:.6g}", f"computed: nominal loop, peak at {at}{ratio}")
        if upper is not None:
            above = f"norm + {at_most(Fraction(upper) - Fraction(norm), 2)}"
            facts.add_row("  at most", above, "proved in ball arithmetic, and so is stability")
    if any(delay.sampled for delay in found.system.delays):
        facts.add_row("  nominal loop", "", "a sampled age stands there with its mean, a constant")
    abscissa = number(found.abscissa, 6, "1/s")
    facts.add_row("abscissa", abscissa, "computed: rightmost root, nominal loop")
    if found.abscissa is not None and found.abscissa < 0.0:
        if found.delay_margin is None:
            facts.add_row(
                "delay margin", "–", "not found: a root comes too close to the imaginary axis"
            )
        for i, margin in enumerate(found.delay_margin or (), 1):
            facts.add_row(
                f"margin of delay {i}",
                "none" if margin is None else f"{margin:.6g} s",
                "computed: stable for every value, the other delays fixed"
                if margin is None
                else "computed: the nominal loop loses stability here, the other delays fixed",
            )


def condition_of(claim: dict[str, Any]) -> str:
    """Name the condition behind a claim."""
    if "nominal loop" in claim["property"]:
        return "level of the norm, argument principle, ball arithmetic"
    if "order" not in claim:
        return "Theorem 2"
    if "hypotheses" in claim:
        return f"ages as they are, order {claim['order']}"
    return "Theorem 1" if claim["order"] == 0 else f"Bessel-Legendre, order {claim['order']}"


def _end(greatest: hinf.GreatestDelay) -> str:
    """Say what is known beyond a greatest delay."""
    if greatest.limit_reached:
        return _LIMIT_REACHED
    if greatest.refuted_at is not None:
        beyond = at_most(greatest.refuted_at)
        return f"certified; from {beyond} s on no solution exists at these k1, k2"
    return "certified; longer delays are not"


def packed_view(packed: ControllerFmu) -> RenderableType:
    """Show a controller FMU that was exported, and what its certificate proves."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    facts = facts_table()
    how = {
        "vehicle": "eta, nu to thrust",
        "system": "x[j] to u[i]",
        "output-feedback": "stamped measurements to u[i]",
        "observer": "stamped measurements and u[i] to the estimate",
    }[packed.form]
    facts.add_row("model", packed.name, Text(f"{packed.kind.text}; {how}"))
    facts.add_row("K", f"{len(packed.K)} x {len(packed.K[0])}", Text("start values of K[i,j]"))
    gamma = packed.claim["gamma"]
    if gamma is not None:
        facts.add_row("gamma", at_most(gamma), "certified, for this K")
    facts.add_row("certificate", packed.sha256[:16], "SHA-256; resources/certificate.json")
    return Group(head, facts)


def vehicle_plant_view(made: VehicleFmu) -> RenderableType:
    """Show the plant FMU of a vehicle that was exported."""
    head = Text.assemble(("packed", "bold green"), f": {made.path}")
    vehicle = made.vehicle
    facts = facts_table()
    facts.add_row("model", made.name, made.kind.text)
    facts.add_row("vehicle", vehicle.name, f"{vehicle.degrees_of_freedom} degrees of freedom")
    commands = [a.command for a in vehicle.actuators]
    facts.add_row("commands", str(len(commands)), ", ".join(commands))
    facts.add_row("states", str(len(vehicle.states)), ", ".join(vehicle.states))
    facts.add_row("parameters", str(len(vehicle.parameters)), "every number of the file")
    facts.add_row("solver.step", f"{made.step:g} s", "largest internal step")
    return Group(head, facts)


def plant_view(packed: PlantFmu) -> RenderableType:
    """Show a plant FMU that was exported: its sizes, and where the delays of its system are."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    facts = facts_table()
    facts.add_row("model", packed.name, packed.kind.text)
    facts.add_row("inputs", f"{m} u, {q} w", "")
    facts.add_row("outputs", f"{n} x, {p} z", "")
    for name, d in packed.delays.items():
        facts.add_row(name, f"{d:g} s", "a parameter, like every matrix entry")
    if not packed.system.immediate_feedback:
        late = f"{packed.system.feedback_delay:g} s"
        facts.add_row(
            "feedback", late, "delay of the link between plant and controller, not in the FMU"
        )
    facts.add_row("solver.step", f"{packed.step:g} s", "largest internal step")
    return Group(head, facts)
