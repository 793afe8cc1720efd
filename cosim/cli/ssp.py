"""Commands for SSP archives, which exchange systems between tools: export, import, check."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Group, RenderableType
from rich.text import Text

from cosim.cli.common import (
    FMUS,
    FmusOption,
    JsonOption,
    RunFlavour,
    answer,
    output_file,
    progress,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.runs import make_fmu_cache
from cosim.cli.terminal import console, facts
from cosim.core import CheckFailedError, InputError
from cosim.fmu import DEFAULT_FLAVOUR
from cosim.scenario import (
    SSP_TOOLS,
    SspCheck,
    SspExport,
    SspImport,
    SspTool,
    SspVersion,
    check_ssp,
    export_ssp,
    import_ssp,
    load,
    prepare,
)

_MOST_PLACES = 5

ssp_app = HelpTyper(
    help="Export a scenario as an SSP archive, import an archive, or check it for other tools.",
)


@ssp_app.command("export")
def export_verb(
    name: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Name of a built-in scenario, or FILE.toml.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="File of the archive (default: NAME.ssp).", callback=output_file
        ),
    ] = None,
    links: Annotated[
        Literal["annotate", "fmu"],
        typer.Option(
            help="annotate: write links as annotations, which other tools ignore; fmu: write each "
            "link as an FMU that delays, drops and reorders the same messages in other tools."
        ),
    ] = "annotate",
    ssp: Annotated[
        SspVersion,
        typer.Option(
            "--ssp", help="Version of the standard; arrays and the types of FMI 3.0 need 2.0."
        ),
    ] = "1.0",
    flavour: Annotated[
        RunFlavour,
        typer.Option(
            help="Built-in FMUs: native (C) for any tool, native-fmi3 for tools of FMI 3.0, python "
            "for Python hosts. FMUs of links and signals are native."
        ),
    ] = DEFAULT_FLAVOUR,
    fmus: FmusOption = FMUS,
    as_json: JsonOption = False,
) -> None:
    """Write a scenario as an SSP archive: FMUs, parameters, gain, connections, end time.

    A reference path or a disturbance becomes an FMU that plays it. Anything that SSP cannot
    express is an error, or is left out with a warning. Prebuilt FMUs are for all platforms;
    FMUs that are compiled are for this machine only.

    With --links fmu the links step on the grid of the other tool, so compare with a scenario that
    has events = "grid".

    \b
    cosim ssp export auv-acoustic -o auv.ssp
    cosim ssp export auv-acoustic -o auv.ssp --links fmu
    cosim ssp check auv.ssp --for omsimulator
    """
    loaded = load(name)
    path = out or Path(f"{loaded.name}.ssp")
    _not_onto(path, Path(name))
    with progress() as report_progress:
        prepared = prepare(
            loaded, make_fmu_cache(fmus, loaded.folder, flavour), progress=report_progress
        )
        exported = export_ssp(prepared, path, links, ssp)
    _warn(exported.warnings)
    answer(as_json, exported.to_json, lambda: _view(exported, exported.components))


@ssp_app.command("import")
def import_verb(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.ssp", help="Any archive of SSP 1.0 or 2.0.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File of the scenario (default: NAME.toml in this folder).",
            callback=output_file,
        ),
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
    """Make a scenario of an SSP archive and unpack its FMUs to the folder NAME_fmus beside it.

    Nested systems become one system with joined names. Parameters are read inline or from .ssv
    files, with mappings. Links that cosim ssp export wrote, as annotations or as FMUs, become
    links again. Anything that is left out is named in a warning.

    \b
    cosim ssp import auv.ssp -o from-ssp.toml
    cosim run from-ssp.toml
    """
    path = out or Path(f"{file.stem}.toml")
    if out is None and path.exists():
        raise InputError(
            "a scenario with this name already exists",
            where=str(path),
            hint=f"another file, or overwrite this one: -o {path}",
        )
    _not_onto(path, file)
    imported = import_ssp(file, path, step=step, end=end)
    _warn(imported.unsupported)
    answer(as_json, imported.to_json, lambda: _view(imported, imported.names.values()))


@ssp_app.command()
def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.ssp", help="Any archive of SSP 1.0 or 2.0.")
    ],
    tools: Annotated[
        list[str] | None,
        typer.Option("--for", metavar="TOOL", help=f"{', '.join(SSP_TOOLS)}; may be repeated."),
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """Say which tools take an archive, why not, and what to do, without having the tools.

    Each finding is what one tool refuses, or runs differently from what the archive describes,
    by rules read from the tools' sources.

    Exit code 0: no tool refuses the archive; 1: one does; 2: the file is not an archive.

    \b
    cosim ssp check auv.ssp
    cosim ssp check theirs.ssp --for omsimulator --for libcosim
    """
    found = check_ssp(file, [_tool(name) for name in tools] if tools else SSP_TOOLS)
    answer(as_json, found.to_json, lambda: _check_view(found))
    if not all(found.takes(tool) for tool in found.tools):
        raise typer.Exit(CheckFailedError.exit_code)


def _tool(name: str) -> SspTool:
    for tool in SSP_TOOLS:
        if name == tool:
            return tool
    raise InputError.unknown("tool", name, SSP_TOOLS, where="--for")


def _check_view(found: SspCheck) -> RenderableType:
    """Show each tool's verdict, and its findings with reason and cure once for each rule."""
    parts: list[RenderableType] = []
    for tool in found.tools:
        mine = [f for f in found.findings if f.tool == tool]
        taken = ("takes it", "bold green") if found.takes(tool) else ("refuses it", "bold red")
        parts.append(Text.assemble((tool, "bold"), " ", taken))
        rules = {(f.code, f.effect, f.reason, f.cure): f for f in mine}
        for code, effect, reason, cure in rules:
            colour = "red" if effect == "refused" else "yellow"
            parts.append(Text.assemble("  ", (effect, f"bold {colour}"), f" {code}: {reason}"))
            places = [f for f in mine if (f.code, f.reason) == (code, reason)]
            listed = [f"{f.where}: {f.got}" for f in places[:_MOST_PLACES]]
            if len(places) > _MOST_PLACES:
                listed.append(f"and {len(places) - _MOST_PLACES} more")
            parts += [Text(f"    {line}") for line in listed]
            parts.append(Text(f"    {cure}", style="dim"))
    return Group(*parts)


def _not_onto(path: Path, source: Path) -> None:
    if path.exists() and source.exists() and path.samefile(source):
        raise InputError(
            "the output would overwrite the input", where=str(path), hint="another file: -o"
        )


def _warn(sentences: Sequence[str]) -> None:
    terminal = console(error=True)
    for sentence in sentences:
        terminal.print(Text.assemble(("warning", "bold yellow"), f": {sentence}"))


def _view(done: SspExport | SspImport, components: Collection[str]) -> RenderableType:
    links = done.links.items() if isinstance(done, SspExport) else dict.fromkeys(done.links).items()
    rows = facts(
        ("components", str(len(components)), ", ".join(components)),
        ("connections", str(done.connections)),
        *(("link", name, f"as {form}" if form else "") for name, form in links),
        ("run", f"{done.end_s:g} s", f"in steps of {done.step_s:g} s"),
    )
    return Group(Text.assemble(("written", "bold green"), f": {done.path}"), rows)
