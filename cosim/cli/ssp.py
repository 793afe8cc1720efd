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
from cosim.cli.terminal import console, facts, typed
from cosim.core import InputError
from cosim.fmu.export import DEFAULT_FLAVOUR
from cosim.scenario import (
    SspCheck,
    SspExport,
    SspImport,
    SspVersion,
    check_ssp,
    export_ssp,
    import_ssp,
    load,
    prepare,
)

ssp_app = HelpTyper(
    help="Export a scenario as an SSP archive, import an archive, or check one.",
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
    cosim ssp check auv.ssp
    """
    loaded = load(name)
    path = out or Path(f"{loaded.name}.ssp")
    _not_onto(path, Path(name))
    with progress() as report_progress:
        prepared = prepare(
            loaded, make_fmu_cache(fmus, loaded.folder, flavour), progress=report_progress
        )
        exported = export_ssp(prepared, path, links, ssp)
    answer(
        as_json,
        exported.to_json,
        lambda: _view(exported, exported.components),
        line=f"written: {exported.path}",
        tone="good",
        then=(typed("ssp check", exported.path),),
    )
    _warn(exported.warnings)


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
    answer(
        as_json,
        imported.to_json,
        lambda: _view(imported, imported.names.values()),
        line=f"written: {imported.path}",
        tone="good",
        then=(typed("scenario check", imported.path), typed("run", imported.path)),
    )
    _warn(imported.unsupported)


@ssp_app.command()
def check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.ssp", help="Any archive of SSP 1.0 or 2.0.")
    ],
    *,
    as_json: JsonOption = False,
) -> None:
    """Say whether an archive can be imported, and which parts of it other tools ignore.

    Events, modes, assertions and links that are annotations of this project are restored by an
    import; other tools ignore them. docs/compatibility.md says what each tool does with archives,
    as found by running them in it.

    Exit code 0: it can be imported; 2: it cannot, or it is not an archive.

    \b
    cosim ssp check auv.ssp
    cosim ssp check theirs.ssp --json
    """
    found = check_ssp(file)
    answer(
        as_json,
        found.to_json,
        lambda: _check_view(found),
        line=f"can be imported: {found.path}, SSP {found.version}",
        tone="good",
        then=(typed("ssp import", found.path),),
    )


def _check_view(found: SspCheck) -> RenderableType:
    """Show what the archive has, what other tools do not carry out, and what is unusual."""
    rows = facts(
        ("components", str(len(found.components)), ", ".join(found.components)),
        ("connections", str(found.connections)),
        *(("link", name, "") for name in found.links),
    )
    lines = [Text.assemble(("warning", "bold yellow"), f": {s}") for s in found.only_here]
    lines += [Text.assemble(("note", "bold"), f": {note}") for note in found.notes]
    return Group(rows, *lines)


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
    return facts(
        ("components", str(len(components)), ", ".join(components)),
        ("connections", str(done.connections)),
        *(("link", name, f"as {form}" if form else "") for name, form in links),
        ("run", f"{done.end_s:g} s", f"in steps of {done.step_s:g} s"),
    )
