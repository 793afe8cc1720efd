"""Which ages of a certificate no run can have, because it holds what it sends.

A measurement, a feedback or a command that is held between messages or steps grows older until the
next one comes. It is never of one age, nor of one that changes continuously; a proof of "exactly
d", of "at once", of a constant age or of one with a bounded rate is about another loop. Delays
inside the plant are not meant.
"""

from __future__ import annotations

import shlex
from pathlib import PurePath
from typing import Any

from cosim.hinf.certificate.output_feedback_certificate import KIND, measurements_from_json
from cosim.hinf.certificate.system_json import system_from_json
from cosim.hinf.certificate.system_parts import number
from cosim.models import Delay, Measurement

COMMANDS, FEEDBACK = "commands", "feedback"
"""Names of what is held, beside those of measurements."""


def constant_ages_claimed(certificate: dict[str, Any]) -> dict[str, float]:
    """Return what a certificate takes to be of a constant or continuous age although it is held.

    Returns
    -------
    dict : name -> the greatest age in the certificate [s], 0 where it acts at once. The names are
        those of measurements, "commands" of an observer's control, "feedback" of a state feedback.
        Empty where a run can have the ages, and for a certificate that is not about a gain.

    Raises
    ------
    InputError : not a certificate.
    """
    if certificate.get("kind") == KIND:
        measurements = measurements_from_json(certificate["measurements"])
        stated = {x.name: x.d for x in measurements if has_constant_age(x)}
        if not certificate["command_any_age"]:
            stated[COMMANDS] = number(certificate["command_age"], "command_age")
        return stated
    K = certificate.get("K")
    if not (K and K[0]):
        return {}
    system = system_from_json(certificate["system"])
    at_once, *delayed = system.selections
    ages = [0.0] if at_once.any() else []
    ages += [
        x.d
        for x, acting in zip(system.delays, delayed, strict=True)
        if acting.any() and has_constant_age(x)
    ]
    return {FEEDBACK: max(ages)} if ages else {}


def has_constant_age(age: Delay | Measurement) -> bool:
    """Whether an age is constant, or changes continuously."""
    return age.d == 0 or not age.any_age or age.rate is not None


def remark_on_ages(certificate: dict[str, Any]) -> str | None:
    """Return in words what no run can show of a certificate; None where there is nothing.

    Raises
    ------
    InputError : not a certificate.
    """
    ages = constant_ages_claimed(certificate)
    if not ages:
        return None
    listed = ", ".join(f"{name} {f'of {d:g} s' if d else 'at once'}" for name, d in ages.items())
    return (
        f"proved for a constant age ({listed}), which nothing has that is held between messages or "
        "steps: no run can claim it. cosim certificate prove FILE proves these gains for any age"
    )


def reproving_command(
    certificate: dict[str, Any], where: str, *, hold: float | None = None
) -> str | None:
    """Return the command that proves the gains of a certificate for ages that a run can have.

    Parameters
    ----------
    certificate : its JSON values.
    where : the file that it is in, such as `gain.json`, `controller.fmu` or a trace.
    hold : greatest age of what acts at once in the certificate [s], as it was measured in a run;
        None: the command has the word SECONDS in its place.

    Returns
    -------
    str | None : one line for a shell; None where every age is one that a run can have.

    Notes
    -----
    The command replaces a `.json` file, which then has the same K and L; of any other file, and of
    `*.design.json`, which a run keeps for its scenario, it makes `*-held.json`.
    """
    ages = constant_ages_claimed(certificate)
    if not ages:
        return None
    path = PurePath(where)
    stem = path.name.removesuffix(path.suffix).removesuffix(".design")
    replaced = path.suffix == ".json" and not path.name.endswith(".design.json")
    target = where if replaced else str(path.with_name(f"{stem}-held.json"))
    words = ["cosim", "certificate", "prove", shlex.quote(where)]
    if 0.0 in ages.values():
        words += ["--hold", "SECONDS" if hold is None else f"{hold:.9g}"]
    return " ".join([*words, "--save", shlex.quote(target)])
