"""Commands for certificates: check, prove."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Group
from rich.text import Text

from cosim import hinf, replay
from cosim.cli.arguments import AUTO, named_problem, order_of, write
from cosim.cli.certificate_view import certificate_line, certificate_view, system_facts
from cosim.cli.common import (
    DetailsOption,
    JsonOption,
    answer,
    output_file,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.result_json import result_json
from cosim.cli.result_view import result_view, verdict
from cosim.cli.terminal import typed
from cosim.core import CheckFailedError, at_most
from cosim.models import DelaySystem

certificate_app = HelpTyper(
    help="Check the certificate of a design or an analysis; prove its gains for other ages."
)


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
    details: DetailsOption = False,
    as_json: JsonOption = False,
) -> None:
    """Prove the claim of a certificate again from the file alone: no solver, no rounding.

    The output names the system that the certificate is about, and the entries of the file that are
    not proved (figures, names); with --details, also the theorem with all its hypotheses. With
    --system, every matrix, delay and age is compared with that system, entry by entry. For a
    controller FMU or a trace, the command also checks that the certificate is about the gain in it:
    the start values of K[i,j], or the gain that the run used.

    Exit code 0: the claim is proved, and about that system; 1: it is not; 2: there is no
    certificate.

    \b
    cosim certificate check gain.json --system paper
    cosim certificate check traces/auv-survey.mcap
    """
    found = replay.certificate_in(file)
    checked = hinf.check_certificate(found.data)
    own = hinf.certificate.system_from_json(found.data.get("plant", found.data.get("system")))
    if checked.valid and found.mismatch is not None:
        checked = replace(checked, valid=False, reason=found.mismatch)
    apart = None if system is None else _differences(own, system, found.data)
    if checked.valid and apart:
        reason = f"it is proved, but about another system than {system}: {apart[0]}"
        checked = replace(checked, valid=False, reason=reason)
    theorem = hinf.certificate.theorem_of(checked.claim)
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
        lambda: certificate_view(checked, found, own, theorem if details else [], system, apart),
        line=certificate_line(str(file), checked),
        tone="good" if checked.valid else "bad",
        then=() if details else (typed("certificate check", file, "--details"),),
    )
    if not checked.valid:
        raise typer.Exit(CheckFailedError.exit_code)


def _differences(own: DelaySystem, name: str, data: dict[str, Any]) -> list[str]:
    """Return where the system of a certificate, and its sensors, differ from those of that name."""
    named: Any = named_problem(name)[0]
    found = list(hinf.certificate.differences(own, named.system))
    sensors = () if named.observer is None else named.observer.measurements
    return found + hinf.certificate.measurement_differences(data.get("measurements", []), sensors)


@certificate_app.command()
def prove(
    file: Annotated[
        Path, typer.Argument(help="A design, or an FMU or trace with the certificate of one.")
    ],
    *,
    hold: Annotated[
        float | None,
        typer.Option(
            help="Greatest age, in seconds, of commands, a state feedback or measurements "
            "that have no age in the certificate: the longest hold plus one step."
        ),
    ] = None,
    order: Annotated[
        str,
        typer.Option(
            help="N: prove with the Bessel-Legendre inequality of order N; auto: with the "
            "best condition that takes a few seconds, as in cosim analyse."
        ),
    ] = "auto",
    save: Annotated[
        Path | None, typer.Option(help="Write the new design to this file.", callback=output_file)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Prove the gains of a design again, for ages that a run can have; K and L stay as they are.

    A value that is held between messages or steps never has a constant age. Where the certificate
    assumes a constant age of a measurement, a feedback or a command, the new proof covers any age
    up to it; where it assumes no age, any age up to --hold. Delays inside the plant stay as they
    are. Anything that the certificate proves beside gamma, such as a rate of decay, is not proved
    again: the output names it.

    Exit code 0: proved; 2: not a design, or --hold is missing; 5: these gains are not proved for
    these ages.

    \b
    cosim certificate prove gain.json --hold 0.1 --save gain.json
    cosim certificate prove flight.mcap --hold 0.1 --save gain.json
    """
    data = replay.certificate_in(file).data
    asked = order_of(order, AUTO) or 0  # never None: Theorem 2 is no word here
    with progress() as report_progress:
        report_progress(f"proof of {file}", 0.0)
        before = hinf.synthesis.Result.from_certificate(data, where=str(file))
        found = hinf.synthesis.proved_again(before, hold=hold, order=asked)
    if save is not None:
        write(save, found.file_text())
    lost = [
        name
        for name in before.certificate["claim"].get("guarantees", {})
        if name not in found.certificate["claim"].get("guarantees", {})
    ]
    answer(
        as_json,
        lambda: (
            result_json(file.stem, found, save)
            | {"gamma_before": before.gamma, "not_proved_again": lost}
        ),
        lambda: Group(result_view(file.stem, found), *_beside(before, lost)),
        **verdict(file.stem, found, save),
    )


def _beside(before: hinf.Result, lost: list[str]) -> list[Text]:
    """Return lines about the certificate that there was."""
    lines = [] if before.gamma is None else [f"gamma before: {at_most(before.gamma)}"]
    lines += [f"not proved again: {', '.join(lost)}"] if lost else []
    return [Text(line) for line in lines]
