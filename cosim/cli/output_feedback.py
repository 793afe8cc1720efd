"""What `design` and `analyse` do with a system file that has an observer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from cosim import hinf
from cosim.cli.arguments import write
from cosim.cli.common import alternatives_named, answer, progress
from cosim.cli.result_json import result_json
from cosim.cli.result_view import result_view, verdict
from cosim.core import InputError

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
    with progress() as report_progress, alternatives_named(None):
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
        write(save, found.file_text())
    answer(
        options["as_json"],
        lambda: result_json(name, found, save),
        lambda: result_view(name, found),
        **verdict(name, found, save),
    )
