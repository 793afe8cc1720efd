"""What `design` and `analyse` do with a system file that has an observer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cosim import hinf
from cosim.cli.arguments import write_json
from cosim.cli.common import answer, progress
from cosim.cli.terminal import facts_table
from cosim.core import DESIGN_FILE, InputError, at_most

if TYPE_CHECKING:
    from cosim.models import Measurement

_OPTIONS = {"name", "gamma", "order", "save", "as_json", "solver", "delay_limit"}
"""Options that an observer has too, or that are without effect alone."""


def answer_output_feedback(
    named: hinf.problem.NamedSystem, options: Mapping[str, Any], order: int | Literal["auto"] | None
) -> None:
    """Design the observer and the gain of a system file, or prove those in it, and print them.

    options : of the command, by name; those of a state feedback alone must not be given.

    Raises
    ------
    InputError : an option or a constraint that only a state feedback has.
    NotAchievableError : no observer and gain were certified.
    """
    settings, name, save = named.observer, options["name"], options["save"]
    if settings is None:
        raise ValueError("expected a system with an observer")
    given = [key for key, value in options.items() if key not in _OPTIONS and value]
    if given or named.design_constraints.any or named.k1 or named.k2 or order is None:
        raise InputError(
            "an observer and its gain are designed for gamma or stability alone",
            where=f"--{given[0].replace('_', '-')}" if given else f"{name}: design",
            expected="no options but --gamma, --order N or auto, --save, --json",
            hint="a state feedback has the others: a system without [[measurements]]",
        )
    with progress() as report_progress:
        report_progress(f"observer and gain of {name}", 0.0)
        found = hinf.design_output_feedback(
            named.system,
            settings.measurements,
            gain=settings.gain,
            injections=settings.injections,
            gamma=named.gamma if options["gamma"] is None else options["gamma"],
            command_age=settings.command_age,
            command_any_age=settings.command_any_age,
            estimated=settings.estimated,
            order=order,
            offset=settings.offset,
            initial_error=settings.initial_error,
            energy=settings.energy,
        )
        if settings.command_age == 0 and not settings.at_once:
            report_progress("commands that are held", 0.0)
            found = hinf.synthesis.for_any_command(found, most=options["gamma"] or named.gamma)
    if save is not None:
        write_json(save, DESIGN_FILE.stamped(found.to_json()))
    answer(
        options["as_json"],
        lambda: output_feedback_json(name, found, save),
        lambda: output_feedback_view(name, found),
    )


def output_feedback_json(
    name: str, found: hinf.OutputFeedback, save: Path | None
) -> dict[str, Any]:
    """Return the object that `--json` prints."""
    pair, ratio = found.pair, None
    if found.gamma is not None and found.exact_norm:
        ratio = found.gamma / found.exact_norm
    return {
        "system": name,
        "kind": "output-feedback",
        "gamma": found.gamma,
        "certified": found.certified,
        "certificate": None if save is None else str(save),
        "order": found.order,
        "up_to_delays": found.covers_smaller_delays,
        "K": found.K.tolist(),
        "L": {x.name: own.tolist() for x, own in zip(found.measurements, found.L, strict=True)},
        "measurements": found.certificate["measurements"],
        "delays": [x.d for x in found.system.delays],
        "known_states": found.certificate["claim"]["observer"]["known_states"],
        "command_age": pair.command_age,
        "command_any_age": pair.command_any_age,
        "constant_ages_claimed": hinf.certificate.constant_ages_claimed(found.certificate),
        "peaks": _peaks(found),
        "least_gamma": found.least_gamma,
        "abscissa": found.abscissa,
        "exact_norm": found.exact_norm,
        "exact_norm_upper": found.exact_norm_upper,
        "norm_frequency": found.norm_frequency,
        "ratio": ratio,
    }


def output_feedback_view(name: str, found: hinf.OutputFeedback) -> RenderableType:
    """Show what is proved of an observer and its gain, what is computed, and the matrices."""
    facts, pair = facts_table(), found.pair
    gamma = "stability only" if found.gamma is None else at_most(found.gamma)
    facts.add_row("gamma", gamma, "certified: exact rational proof of plant and observer together")
    if found.exact_norm is not None:
        facts.add_row("exact norm", f"{found.exact_norm:.6g}", "computed: of the nominal pair")
    facts.add_row("abscissa", f"{found.abscissa:.6g} 1/s", "computed: of the nominal pair")
    for x in found.measurements:
        facts.add_row(f"measured: {x.name}", f"{x.d:g} s", _age_of(x))
    if pair.command_age:
        kind = "any age up to this" if pair.command_any_age else "constant"
        facts.add_row("command", f"{pair.command_age:g} s", kind)
    known = found.certificate["claim"]["observer"]["known_states"]
    if known:
        facts.add_row("known states", ", ".join(map(str, known)), "driven by u as it acts")
    for key, bound in (_peaks(found) or {}).items():
        facts.add_row(f"peak of {key}", at_most(bound), "certified: from offset, with energy")
    parts: list[RenderableType] = [facts, f"K ({name}): u = K xh", _matrix(found.K)]
    for x, own in zip(found.measurements, found.L, strict=True):
        parts += [f"L of {x.name}", _matrix(own)]
    remark = hinf.certificate.remark_on_ages(found.certificate)
    if remark is not None:
        parts.append(Text.assemble(("remark", "bold yellow"), f": {remark}"))
    return Group(*parts)


def _peaks(found: hinf.OutputFeedback) -> dict[str, float] | None:
    """Return the proved peaks of u_1 .. and x_1 .., rounded up; None where none were asked for."""
    if found.state_peaks is None:
        return None
    (n, m) = found.system.B.shape
    names = [*(f"u_{i + 1}" for i in range(m)), *(f"x_{i + 1}" for i in range(n))]
    return {k: float(x) for k, x in zip(names, found.state_peaks.bounds, strict=True)}


def _age_of(x: Measurement) -> str:
    words = "at once" if x.d == 0 else x.delay(1).description.partition(", ")[2] or "constant"
    noise = ", ".join(f"{v:.6g}" for v in x.noise)
    return f"{words}; over {x.over}" + (f"; noise {noise}" if any(x.noise) else "")


def _matrix(rows: Any) -> Table:
    table = Table(show_header=False, box=None)
    for row in rows:
        table.add_row(*(f"{value:.4g}" for value in row))
    return table
