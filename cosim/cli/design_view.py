"""Designs, analyses, certificates and what is packed, for people; `--json` prints none of it."""

from __future__ import annotations

from fractions import Fraction

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim.cli.terminal import facts_table, number
from cosim.fmu import ControllerFmu, PlantFmu
from cosim.hinf import Analysis, CertificateCheck, CertifiedDelay, Design, GreatestDelay, Guarantees
from cosim.models import Delay
from cosim.replay import EmbeddedCertificate

_WHOSE = {
    "file": "",
    "FMU": "which the FMU starts with; any other that is set voids this",
    "trace": "which flew",
}


def design_view(
    name: str,
    design: Design,
    greatest: GreatestDelay | None = None,
    nominal: float | None = None,
) -> RenderableType:
    """A design: what is proved, what is computed, and the gain."""
    facts = facts_table()
    gamma = "stability only" if design.gamma is None else f"{design.gamma:.6g}"
    facts.add_row("gamma", gamma, "certified: exact rational proof, for the gain below as it flies")
    if nominal is not None and design.gamma is not None:
        facts.add_row(
            "  without uncertainty",
            f"{nominal:.6g}",
            f"certified, same gain, k1, k2: {design.gamma - nominal:.3g} are paid for E, H",
        )
    _nominal_rows(facts, design)
    if design.order is not None:
        facts.add_row("condition", _condition(design.order), "")
    for row in _guarantees(design.guarantees):
        facts.add_row(*row)
    for i, delay in enumerate(design.system.delays):
        scalars = f"; k1 = {design.k1[i]:g}, k2 = {design.k2[i]:g}" if design.k2 else ""
        facts.add_row(
            f"delay {i + 1}",
            f"{delay.d:g} s",
            _age(delay, covers_smaller_delays=design.covers_smaller_delays) + scalars,
        )
    if greatest is not None:
        facts.add_row("greatest delay", f"{greatest.delay:.6g} s", _end(greatest))
    gain = Table(title=f"K ({name}): u = K x", title_justify="left", show_header=False, box=None)
    for row in design.K:
        gain.add_row(*(f"{value:.4g}" for value in row))
    return Group(facts, gain)


def _guarantees(more: Guarantees) -> list[tuple[str, str, str]]:
    """What is proved beside gamma: (figure, value, what it says)."""
    rows = []
    if more.decay is not None:
        text = "certified: with w = 0 every solution falls at least as exp(-rate t)"
        rows.append(("rate of decay", f"{float(more.decay.rate):.6g} 1/s", text))
    if more.gain_limit is not None:
        rows.append(("|K|", f"{float(more.gain_limit.bound):.6g}", "certified: at most this"))
    if more.peak_control is not None:
        peak = more.peak_control
        start = ", ".join(f"{float(x):g}" for x in peak.offset)
        text = f"certified: |u_{{}}(t)| at most this, from |x| <= ({start})"
        if peak.energy != 0:
            text += f", with (int w'w)^(1/2) <= {float(peak.energy):g}"
        rows += [
            (f"peak of u_{i}", f"{float(bound):.6g}", text.format(i))
            for i, bound in enumerate(peak.bounds, 1)
        ]
    return rows


def analysis_view(
    name: str, analysis: Analysis, greatest: CertifiedDelay | None = None
) -> RenderableType:
    """What a given gain guarantees: what is proved, or why nothing is, and what is computed."""
    what = f"{name}, u = 0" if analysis.K is None else f"{name}, u = K x"
    if analysis.certified:
        head = Text.assemble(("certified", "bold green"), f": {what}")
    else:
        head = Text.assemble(("not certified", "bold yellow"), f": {what}\n  {analysis.reason}")
    facts = facts_table()
    facts.add_row("condition", _condition(analysis.order), "")
    if analysis.certified:
        gamma = "stability only" if analysis.gamma is None else f"{analysis.gamma:.6g}"
        facts.add_row("gamma", gamma, "certified: exact rational proof, for this gain")
    _nominal_rows(facts, analysis)
    for i, delay in enumerate(analysis.system.delays):
        facts.add_row(
            f"delay {i + 1}",
            f"{delay.d:g} s",
            _age(delay, covers_smaller_delays=analysis.covers_smaller_delays),
        )
    if greatest is not None and greatest.d is not None:
        end = (
            "certified; the search ended here, the loop may bear more"
            if greatest.limit_reached
            else f"certified; not certified at {greatest.not_certified_at:.7g} s"
        )
        facts.add_row("greatest delay", f"{greatest.d:.7g} s", end)
    return Group(head, facts)


def _age(delay: Delay, *, covers_smaller_delays: bool) -> str:
    kind = "any age up to it" if delay.any_age else "constant, "
    if not delay.any_age:
        kind += "up to it" if covers_smaller_delays else "exactly it"
    return kind + (", the control acts through it" if delay.feedback else "")


def _nominal_rows(facts: Table, found: Design | Analysis) -> None:
    """Rows: what is true of the nominal loop, all of its delays taken as constants."""
    norm, upper = found.exact_norm, found.exact_norm_upper
    if norm is not None:
        peak = found.norm_frequency
        at = "infinite frequency" if peak is None else f"{peak:.4g} rad/s"
        ratio = (
            "" if found.gamma is None or not norm else f"; gamma is {found.gamma / norm:.4g} of it"
        )
        facts.add_row("exact norm", f"{norm:.6g}", f"computed: nominal loop, peak at {at}{ratio}")
        if upper is not None:
            above = f"norm + {upper - norm:.1e}"
            facts.add_row("  at most", above, "proved in ball arithmetic, stability with it")
    abscissa = number(found.abscissa, 6, "1/s")
    facts.add_row("abscissa", abscissa, "computed: rightmost root, nominal loop")
    if found.abscissa is not None and found.abscissa < 0.0:
        if found.delay_margin is None:
            facts.add_row("delay margin", "–", "a root comes too close to the axis to be told")
        for i, margin in enumerate(found.delay_margin or (), 1):
            facts.add_row(
                f"margin of delay {i}",
                "none" if margin is None else f"{margin:.6g} s",
                "computed: "
                + (
                    "stable however long it is, the others held"
                    if margin is None
                    else "nominal stability is lost there, the others held"
                ),
            )


def _condition(order: int) -> str:
    return "Theorem 1" if order == 0 else f"Bessel-Legendre, order {order}"


def _end(greatest: GreatestDelay) -> str:
    """What is known beyond a greatest delay."""
    if greatest.limit_reached:
        return "certified; the search ended here, the loop may bear more"
    if greatest.refuted_at is not None:
        return f"certified; from {greatest.refuted_at:.6g} s on proved to be none at these k1, k2"
    return "certified; nothing is certified beyond"


def certificate_view(
    file: str, certificate: CertificateCheck, found: EmbeddedCertificate
) -> RenderableType:
    """A check of a certificate: proved or not, what is claimed, and of which gain."""
    claim = certificate.claim
    verdict = (
        Text.assemble(("proved", "bold green"), f": {file}")
        if certificate.valid
        else Text.assemble(("not proved", "bold red"), f": {file}\n  {certificate.reason}")
    )
    facts = facts_table()
    facts.add_row("claim", claim["property"], "")
    facts.add_row("condition", _condition(claim["order"]) if "order" in claim else "Theorem 2", "")
    if claim["gamma"] is not None:
        facts.add_row("gamma", f"{float(Fraction(claim['gamma'])):.7g}", "the file has it exactly")
    for name in (name for name in ("k1", "k2") if name in claim):
        facts.add_row(name, ", ".join(f"{float(Fraction(x)):g}" for x in claim[name]), "")
    for i, delay in enumerate(claim["delays"], 1):
        acts = ", the control acts through it" if delay["feedback"] else ""
        facts.add_row(f"delay {i}", f"{delay['d']:g} s", f"{delay['age']}{acts}")
    facts.add_row("uncertainty", "every F(t) with F'F <= I" if claim["uncertain"] else "none", "")
    for name, more in claim.get("guarantees", {}).items():
        exact = more.get("rate", more.get("bound", more.get("bounds")))
        values = exact if isinstance(exact, list) else [exact]
        formatted = ", ".join(f"{float(Fraction(value)):.7g}" for value in values)
        facts.add_row(name.replace("_", " "), formatted, more["property"])
    if "K" in found.data:  # what refutes speaks of every gain
        facts.add_row("gain", "K in the certificate", _WHOSE[found.container])
    facts.add_row("SHA-256", f"{found.sha256}"[:16], "of the certificate without notes")
    return Group(verdict, facts)


def packed_view(packed: ControllerFmu) -> RenderableType:
    """A controller FMU that was made, and what its certificate proves."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    facts = facts_table()
    how = "eta, nu to thrust" if packed.form == "vehicle" else "x[j] to u[i]"
    facts.add_row("model", packed.name, f"{packed.kind.text}; {how}")
    facts.add_row("K", f"{len(packed.K)} x {len(packed.K[0])}", Text("start values of K[i,j]"))
    gamma = packed.claim["gamma"]
    if gamma is not None:
        facts.add_row("gamma", f"{float(Fraction(gamma)):.7g}", "certified, for this K")
    facts.add_row("certificate", packed.sha256[:16], "SHA-256; resources/certificate.json")
    return Group(head, facts)


def plant_view(packed: PlantFmu) -> RenderableType:
    """A plant FMU that was made: its sizes, and where the delays of its system are."""
    head = Text.assemble(("packed", "bold green"), f": {packed.path}")
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    facts = facts_table()
    facts.add_row("model", packed.name, packed.kind.text)
    facts.add_row("inputs", f"{m} u, {q} w", "")
    facts.add_row("outputs", f"{n} x, {p} z", "")
    for name, d in packed.delays.items():
        facts.add_row(name, f"{d:g} s", "a parameter, as every entry of every matrix")
    if not packed.system.immediate_feedback:
        late = f"{packed.system.feedback_delay:g} s"
        facts.add_row("feedback", late, "of the link between plant and controller, not in the FMU")
    facts.add_row("solver.step", f"{packed.step:g} s", "largest internal step")
    return Group(head, facts)
