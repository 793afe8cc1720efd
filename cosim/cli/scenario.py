"""Commands for scenarios: list, new, check, show, schema."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.text import Text

from cosim import scenario as scenarios
from cosim.cli.arguments import write
from cosim.cli.common import (
    FMUS,
    FmusOption,
    JsonOption,
    ScenarioArgument,
    SetOption,
    answer,
)
from cosim.cli.help_text import HelpTyper
from cosim.cli.runs import make_fmu_cache
from cosim.cli.terminal import console, titles_table, typed
from cosim.core import CosimError, InputError, counted

scenario_app = HelpTyper(help="List, create, check and show scenarios (TOML files).")


@scenario_app.command("list")
def list_scenarios(*, as_json: JsonOption = False) -> None:
    """List the built-in scenarios.

    \b
    cosim scenario list
    """
    found = [(name, scenarios.load(name).scenario) for name in scenarios.builtin_names()]
    rows: list[dict[str, Any]] = [
        {
            "name": name,
            "title": scenario.title,
            "description": scenario.description.strip(),
            "components": list(scenario.components),
            "links": list(scenario.links),
            "assertions": [part.words for part in scenario.assertions],
        }
        for name, scenario in found
    ]
    answer(
        as_json,
        lambda: {"scenarios": rows},
        lambda: titles_table("scenario", "title", rows),
        line=f"{len(rows)} scenarios are built in; each has its own FMUs, links and assertions",
        then=("cosim run auv-acoustic", "cosim scenario new mine --from auv-acoustic"),
    )


@scenario_app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the scenario; the file is NAME.toml.")],
    base: Annotated[
        str | None, typer.Option("--from", help="Extend this built-in scenario.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a new scenario file with comments that explain each line.

    \b
    cosim scenario new mine
    cosim scenario new slower --from auv-acoustic
    """
    stem = name.removesuffix(".toml")
    if not re.fullmatch(scenarios.NAME_PATTERN, Path(stem).name):
        raise InputError(
            "not a valid name for a scenario",
            where=name,
            expected="a letter, then letters, digits, _ or -",
        )
    path = Path(f"{stem}.toml")
    if path.exists():
        raise InputError("this file already exists", where=str(path), hint="use another name")
    write(path, scenarios.template(Path(stem).name, base))
    like = "a vehicle over an acoustic link" if base is None else f"{base} and what differs"
    answer(
        as_json,
        lambda: {"file": str(path), "extends": base},
        line=f"written: {path}, {like}",
        tone="good",
        then=(typed("scenario check", path), typed("run", path)),
    )


@scenario_app.command()
def check(
    names: Annotated[
        list[str], typer.Argument(help="Scenario files, or names of built-in scenarios.")
    ],
    changed: SetOption = None,
    fmus: FmusOption = FMUS,
    as_json: JsonOption = False,
) -> None:
    """List everything that is wrong with scenarios, without running them.

    Exit code 0: nothing is wrong; 2: at least one scenario has an error.

    \b
    cosim scenario check mine.toml slower.toml
    """
    found = {name: _problems(name, list(changed or ()), fmus) for name in names}
    rows = [
        {"scenario": name, "ok": not problems, "problems": [p.to_json() for p in problems]}
        for name, problems in found.items()
    ]
    line = "; ".join(
        f"{name}: {counted(len(problems), 'error') if problems else 'ok'}"
        for name, problems in found.items()
    )
    listed = "\n".join(problem.text() for problems in found.values() for problem in problems)
    wrong = any(found.values())
    answer(
        as_json,
        lambda: {"scenarios": rows},
        (lambda: Text(listed, no_wrap=True, overflow="ignore")) if wrong else None,
        line=line,
        tone="bad" if wrong else "good",
        then=() if wrong else tuple(typed("run", name) for name in found),
    )
    if wrong:
        raise typer.Exit(InputError.exit_code)


def _problems(name: str, settings: list[str], fmus: Path) -> list[CosimError]:
    try:
        source = scenarios.with_settings(scenarios.open_source(name), settings)
        return scenarios.problems_of(source, make_fmu_cache(fmus, source.folder))
    except CosimError as error:
        return [error]


@scenario_app.command()
def show(
    name: ScenarioArgument,
    changed: SetOption = None,
    diagram: Annotated[
        Literal["text", "mermaid"] | None,
        typer.Option(help="Print a diagram of components, links and connections instead."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Show a scenario as it will be run, with everything it extends, in SI units.

    \b
    cosim scenario show auv-acoustic --set links.uplink.loss=0.2
    cosim scenario show auv-acoustic --diagram text
    """
    loaded = scenarios.load(name, list(changed or ()))
    if diagram is not None:
        text = (scenarios.as_text if diagram == "text" else scenarios.as_mermaid)(loaded.scenario)
        data: dict[str, Any] = {"scenario": loaded.name, "diagram": text}
    else:
        text = loaded.scenario.to_toml()
        data = {"scenario": loaded.name, "content": loaded.scenario.to_data()}
    if as_json:
        print(json.dumps(data, indent=1, allow_nan=False))
    else:
        console().print(text, soft_wrap=True)


@scenario_app.command()
def schema(*, as_json: JsonOption = False) -> None:
    """Print the JSON Schema of scenarios, for editors that complete and check TOML.

    Write it to a file beside your scenario, and make this the first line of the scenario:
    #:schema ./scenario.schema.json

    \b
    cosim scenario schema > scenario.schema.json
    """
    del as_json  # the output is JSON with or without it
    print(json.dumps(scenarios.json_schema(), indent=1))
