"""What is certified of a loop, formatted for a terminal: a design, an analysis, an observer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypedDict

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim import hinf
from cosim.cli.terminal import NONE, facts, number, typed
from cosim.core import at_least, at_most

if TYPE_CHECKING:
    from pathlib import Path

    from cosim.models import Delay, DelaySystem, Measurement


class Verdict(TypedDict):
    """The answer about a loop, as the keywords of `cosim.cli.common.answer`."""

    line: str
    tone: str
    then: tuple[str, ...]


Row = tuple[str, str, str]
"""Label, value, and how the value was obtained."""


def result_view(
    name: str,
    result: hinf.Result,
    greatest: hinf.GreatestDelay | None = None,
    nominal: float | None = None,
    remark: str | None = None,
    *,
    hint: str | None = None,
) -> RenderableType:
    """Show the gains, and what their proof rests on; where nothing is proved, why.

    nominal : gamma without uncertainty, if it was computed.
    remark : on the size of the gain.
    hint : what can be proved instead, where nothing is.
    """
    remarks = [remark]
    if result.certificate is not None and result.K.any():
        remarks.append(hinf.certificate.remark_on_ages(result.certificate))
    lines = [Text.assemble(("remark", "bold yellow"), f": {text}") for text in remarks if text]
    rows = facts(
        *_proved(result, nominal),
        *_nominal_rows(result),
        *_feedback_rows(result.system),
        *_delay_rows(result),
        *_observer_rows(result),
        *_greatest_delay_row(greatest),
    )
    why = [] if result.certified else [Text(f"{result.reason}")]
    why += [] if hint is None else [Text(f"try: {hint}")]
    return Group(*why, *_gains(name, result), rows, *lines)


def verdict(
    name: str,
    result: hinf.Result,
    saved: Path | None,
    greatest: hinf.GreatestDelay | None = None,
) -> Verdict:
    """Return the answer about a loop: whether it is proved, of what, and where that was saved.

    saved : the file of the design or of the certificate, if there is one.
    """
    what = f"{name}, u = K x" if result.K.any() else f"{name}, u = 0"
    if result.observer is not None:
        what = f"{name}, u = K xh"
    if not result.certified:
        return {"line": f"not certified, {result.verdict}: {what}", "tone": "open", "then": ()}
    bound = "stable" if result.gamma is None else f"gamma {at_most(result.gamma)}"
    if greatest is not None and greatest.delay is not None:
        bound += f", delay {greatest.delay_index + 1} up to {at_least(greatest.delay)} s"
    where = "" if saved is None else f"; saved: {saved}"
    check = () if saved is None else (typed("certificate check", saved),)
    return {"line": f"certified: {what}; {bound}{where}", "tone": "good", "then": check}


def _proved(result: hinf.Result, nominal: float | None) -> Iterator[Row]:
    """Yield what is proved, and by which condition."""
    proof = result.certificate or {"claim": {"property": "", "order": result.order}}
    if result.certified:
        gamma = "stability only" if result.gamma is None else at_most(result.gamma)
        whose = (
            "for the gain above" if result.observer is None else "of plant and observer together"
        )
        yield "gamma", gamma, f"certified: exact rational proof {whose}"
    if nominal is not None and result.gamma is not None:
        which = "certified, same gain and condition: E and H account for"
        yield "  without uncertainty", at_most(nominal), f"{which} {result.gamma - nominal:.3g}"
    yield "condition", condition_of(proof["claim"]), ""
    yield from guarantee_rows(result.guarantees)
    if result.damping_reason is not None:
        yield "damping ratio", "not proved", result.damping_reason


def _delay_rows(result: hinf.Result) -> Iterator[Row]:
    """Yield each delay, and which ages the proof covers."""
    for i, delay in enumerate(result.system.delays):
        scalars = f"; k1 = {result.k1[i]:g}, k2 = {result.k2[i]:g}" if result.k2 else ""
        yield f"delay {i + 1}", f"{delay.d:g} s", _age(delay, result) + scalars


def _greatest_delay_row(greatest: hinf.GreatestDelay | None) -> Iterator[Row]:
    if greatest is not None and greatest.delay is not None:
        yield "greatest delay", f"{at_least(greatest.delay)} s", _end(greatest)


def _gains(name: str, result: hinf.Result) -> list[RenderableType]:
    """Return the gain, and the injections of an observer, each with its title."""
    if not result.K.any():
        return []
    of = "xh" if result.observer is not None else "x"
    parts: list[RenderableType] = [f"K ({name}): u = K {of}", _matrix(result.K)]
    for x, injection in zip(result.measurements, result.L, strict=True):
        parts += [f"L of {x.name}", _matrix(injection)]
    return parts


def _observer_rows(result: hinf.Result) -> Iterator[Row]:
    """Yield what an observer receives and knows, and what is proved of its peaks."""
    if result.observer is None:
        return
    for x in result.measurements:
        yield f"measured: {x.name}", f"{x.d:g} s", _age_of(x)
    pair = result.observer
    if pair.command_age:
        kind = "any age up to this" if pair.command_any_age else "constant"
        yield "command", f"{pair.command_age:g} s", kind
    known = result.certificate["claim"]["observer"]["known_states"]
    if known:
        yield "known states", ", ".join(map(str, known)), "driven by u as it acts"
    for key, bound in (peaks_of(result) or {}).items():
        yield f"peak of {key}", at_most(bound), "certified: from offset, with energy"


def peaks_of(result: hinf.Result) -> dict[str, float] | None:
    """Return the proved peaks of u_1 .. and x_1 .., rounded up; None where none were asked for."""
    peaks = result.guarantees.state_peaks
    if peaks is None:
        return None
    (n, m) = result.system.B.shape
    names = [*(f"u_{i + 1}" for i in range(m)), *(f"x_{i + 1}" for i in range(n))]
    return {k: float(x) for k, x in zip(names, peaks.bounds, strict=True)}


def _age_of(x: Measurement) -> str:
    words = "at once" if x.d == 0 else x.delay(1).description.partition(", ")[2] or "constant"
    noise = ", ".join(f"{v:.6g}" for v in x.noise)
    return f"{words}; over {x.over}" + (f"; noise {noise}" if any(x.noise) else "")


def _matrix(rows: Any) -> Table:
    table = Table(show_header=False, box=None)
    for row in rows:
        table.add_row(*(f"{value:.4g}" for value in row))
    return table


def guarantee_rows(more: hinf.certificate.Guarantees) -> list[Row]:
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
        outages = more.outages
        rates = f"V falls at 2 x {at_least(str(outages.alpha))} 1/s with the link up"
        text = f"{rates}, grows at most at 2 x {at_most(str(outages.beta))} 1/s in outages, u = 0"
        rows.append(
            (
                "link-up time needed",
                f"{at_most(str(100 * outages.share), 4)} %",
                f"certified: {text}",
            )
        )
        if outages.gamma is not None:
            text = "certified: weighted with V's rates, across any outages"
            rows.append(("gain across outages", at_most(str(outages.gamma)), text))
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


def _age(delay: Delay, result: hinf.Result) -> str:
    """Say which ages a proof covers, or was looked for."""
    if not delay.any_age:
        kind = (
            "any constant up to this" if result.covers_smaller_delays else "exactly this constant"
        )
    elif result.certificate is None or "hypotheses" not in result.certificate["claim"]:
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


def _feedback_rows(system: DelaySystem) -> Iterator[Row]:
    """Yield what is fed back, where that is not the whole state alike."""
    if not system.is_structured:
        return
    if system.feedback is not None and any(system.feedback):
        yield "feedback", states_text(system.feedback), "at once"
    lost = [not own for own in system.measured]
    if any(lost):
        yield "not measured", states_text(lost), "K is zero there"
    if system.integrals:
        n = len(system.A)
        last = [j >= n - system.integrals for j in range(n)]
        yield "integrals", states_text(last), "kept by the controller; outputs z too"


def _nominal_rows(result: hinf.Result) -> Iterator[Row]:
    """Yield the figures of the nominal loop, with all delays constant."""
    norm, upper = result.exact_norm, result.exact_norm_upper
    if norm is not None:
        peak = result.norm_frequency
        at = "infinite frequency" if peak is None else f"{peak:.4g} rad/s"
        ratio = (
            ""
            if result.gamma is None or not norm
            else f"; gamma is {result.gamma / norm:.4g} of it"
        )
        yield "exact norm", f"{norm:.6g}", f"computed: nominal loop, peak at {at}{ratio}"
        if upper is not None:
            above = f"norm + {at_most(Fraction(upper) - Fraction(norm), 2)}"
            yield "  at most", above, "proved in ball arithmetic, and so is stability"
    if any(delay.sampled for delay in result.system.delays):
        yield "  nominal loop", "", "a sampled age stands there with its mean, a constant"
    abscissa = number(result.abscissa, 6, "1/s")
    yield "abscissa", abscissa, "computed: rightmost root, nominal loop"
    if result.abscissa is not None and result.abscissa < 0.0:
        if result.delay_margin is None:
            reason = "not found: a root comes too close to the imaginary axis"
            yield "delay margin", NONE, reason
        for i, margin in enumerate(result.delay_margin or (), 1):
            stable, lost = "stable for every value", "the nominal loop loses stability here"
            yield (
                f"margin of delay {i}",
                "none" if margin is None else f"{margin:.6g} s",
                f"computed: {stable if margin is None else lost}, the other delays fixed",
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
        return "certified; the search ended here, longer delays may be certified too"
    if greatest.refuted_at is not None:
        beyond = at_most(greatest.refuted_at)
        return f"certified; from {beyond} s on no solution exists at these k1, k2"
    if greatest.not_certified_at is not None:
        return f"certified; not certified at {at_most(greatest.not_certified_at)} s"
    return "certified; longer delays are not"
