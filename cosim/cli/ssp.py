"""Verbs about SSP, the archives that other tools share systems in: export, import."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.common import FMUS, FmusOption, JsonOption, answer, make_fmu_cache, progress
from cosim.cli.run import Flavour
from cosim.cli.terminal import console, facts_table
from cosim.core import InputError
from cosim.scenario import SspExport, SspImport, export_ssp, import_ssp, load, prepare

ssp_app = typer.Typer(
    no_args_is_help=True,
    help="Give a scenario to other tools as an SSP archive, or make a scenario of theirs.",
)


class LinksKind(enum.Enum):
    """What --links takes."""

    annotate = "annotate"
    fmu = "fmu"


@ssp_app.command("export")
def export_verb(
    name: Annotated[str, typer.Argument(metavar="SCENARIO", help="A name, or FILE.toml.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="The archive (default: NAME.ssp).")
    ] = None,
    links: Annotated[
        LinksKind,
        typer.Option(
            help="Links as annotations, which other tools ignore; or each as an FMU that delays, "
            "loses and orders messages there as here."
        ),
    ] = LinksKind.annotate,
    flavour: Annotated[
        Flavour,
        typer.Option(help="The built-in FMUs: C, for any tool, or Python, for Python hosts."),
    ] = Flavour.native,
    fmus: FmusOption = FMUS,
    as_json: JsonOption = False,
) -> None:
    """Write a scenario as SSP 1.0: FMUs, parameters with the designed gain, connections, end.

    A reference path or disturbance becomes an FMU that plays it. What an archive cannot say is
    refused, or left out and named as a warning. The archive holds FMUs for this machine.

    Link FMUs step on the other tool's grid: compare with events = "grid". They need a C compiler.

    Examples: cosim ssp export auv-acoustic -o auv.ssp; the same with --links fmu.
    """
    loaded = load(name)
    path = out or Path(f"{loaded.name}.ssp")
    _not_onto(path, Path(name))
    with progress() as report_progress:
        prepared = prepare(
            loaded, make_fmu_cache(fmus, loaded.folder, flavour.value), progress=report_progress
        )
        exported = export_ssp(prepared, path, links.value)
    _warn(exported.warnings)
    answer(as_json, exported.to_json, lambda: _exported_view(exported))


@ssp_app.command("import")
def import_verb(
    file: Annotated[Path, typer.Argument(metavar="FILE.ssp", help="Any archive of SSP 1.0.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="The scenario (default: NAME.toml in this folder)."),
    ] = None,
    step: Annotated[
        float | None, typer.Option(min=1e-9, max=1e8, help="Communication step in seconds.")
    ] = None,
    end: Annotated[
        float | None, typer.Option(min=1e-9, max=1e8, help="End of the run in seconds.")
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """Make a scenario of an archive: its FMUs go into the folder NAME_fmus beside the TOML.

    Systems in systems become one, a path of names one name. Parameters are taken inline or from
    .ssv files, with mappings. Links that cosim ssp export wrote, as annotations or as FMUs, are
    links again. What is left out is named.

    Examples: cosim ssp import theirs.ssp -o theirs.toml; then cosim run theirs.toml.
    """
    path = out or Path(f"{file.stem}.toml")
    if out is None and path.exists():
        raise InputError(
            "a scenario of this name is there already",
            where=str(path),
            hint=f"another file, or this one all the same: -o {path}",
        )
    _not_onto(path, file)
    imported = import_ssp(file, path, step=step, end=end)
    _warn(imported.unsupported)
    answer(as_json, imported.to_json, lambda: _imported_view(imported))


def _not_onto(path: Path, source: Path) -> None:
    if path.exists() and source.exists() and path.samefile(source):
        raise InputError(
            "this would write over what is read", where=str(path), hint="another file: -o"
        )


def _warn(sentences: Sequence[str]) -> None:
    terminal = console(error=True)
    for sentence in sentences:
        terminal.print(Text.assemble(("warning", "bold yellow"), f": {sentence}"))


def _exported_view(exported: SspExport) -> RenderableType:
    facts = facts_table()
    facts.add_row("components", str(len(exported.components)), ", ".join(exported.components))
    facts.add_row("connections", str(exported.connections), "")
    for name, fate in exported.links.items():
        facts.add_row("link", name, f"as {fate}")
    facts.add_row("run", f"{exported.end_s:g} s", f"in steps of {exported.step_s:g} s")
    return Group(Text.assemble(("written", "bold green"), f": {exported.path}"), facts)


def _imported_view(imported: SspImport) -> RenderableType:
    facts = facts_table()
    facts.add_row("components", str(len(imported.names)), ", ".join(imported.names.values()))
    facts.add_row("connections", str(imported.connections), "")
    for name in imported.links:
        facts.add_row("link", name, "")
    facts.add_row("run", f"{imported.end_s:g} s", f"in steps of {imported.step_s:g} s")
    return Group(Text.assemble(("written", "bold green"), f": {imported.path}"), facts)
