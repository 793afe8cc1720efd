"""Commands for certificates: check."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import hinf, replay
from cosim.cli.arguments import named_problem
from cosim.cli.certificate_view import certificate_view, system_facts
from cosim.cli.common import JsonOption, answer
from cosim.cli.help_text import HelpTyper
from cosim.core import CheckFailedError
from cosim.models import DelaySystem

certificate_app = HelpTyper(help="Check the certificate of a design or an analysis.")


@certificate_app.command()
def check(
    file: Annotated[
        Path,
        typer.Argument(help="A file written by --save, or an FMU or trace with a certificate."),
    ],
    *,
    system: Annotated[
        str | None,
        typer.Option(
            help="Also check that the certificate is about exactly this system: paper, auv, the "
            "name of a scenario, or a system FILE.toml."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Prove the claim of a certificate again from the file alone: no solver, no rounding.

    The output names the system that the certificate is about, the theorem with all its
    hypotheses, and the entries of the file that nothing proves (figures, names). With --system,
    every matrix, delay and age is compared, entry by entry. For a controller FMU or a trace, the
    command also checks that the certificate is about the gain in it: the start values of K[i,j],
    or the gain that the run used.

    Exit code 0: the claim is proved, and about that system; 1: it is not; 2: there is no
    certificate.

    \b
    cosim certificate check gain.json --system paper
    cosim certificate check traces/auv-acoustic.mcap
    """
    found = replay.certificate_in(file)
    checked = hinf.check_certificate(found.data)
    own = hinf.system_from_json(found.data.get("plant", found.data.get("system")))
    if checked.valid and found.mismatch is not None:
        checked = replace(checked, valid=False, reason=found.mismatch)
    apart = None if system is None else _differences(own, system, found.data)
    if checked.valid and apart:
        reason = f"it is proved, but about another system than {system}: {apart[0]}"
        checked = replace(checked, valid=False, reason=reason)
    theorem = hinf.theorem_of(checked.claim)
    answer(
        as_json,
        lambda: {
            "file": str(file),
            "container": found.container,
            "sha256": found.sha256,
            "valid": checked.valid,
            "reason": checked.reason,
            "claim": checked.claim,
            "not_read": list(checked.not_read),
            "system": system_facts(own),
            "theorem": theorem,
            "compared_with": system,
            "differences": apart,
        },
        lambda: certificate_view(str(file), checked, found, own, theorem, system, apart),
    )
    if not checked.valid:
        raise typer.Exit(CheckFailedError.exit_code)


def _differences(own: DelaySystem, name: str, data: dict[str, Any]) -> list[str]:
    """Return where the system of a certificate, and its sensors, differ from those of that name."""
    named: Any = named_problem(name)[0]
    found = list(hinf.differences(own, named.system))
    sensors = () if named.observer is None else named.observer.measurements
    return found + hinf.measurement_differences(data.get("measurements", []), sensors)
