"""Commands for scenarios: list, new, check, show, schema."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Group
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
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="NAME",
            help="Name of the scenario; the file is NAME.toml. With FMUs after --from, the "
            "name can be left out, and further FMUs can follow.",
        ),
    ] = None,
    base: Annotated[
        list[str] | None,
        typer.Option(
            "--from",
            help="Extend this built-in scenario; or connect FMUs, given by their paths or "
            "built-in names.",
        ),
    ] = None,
    link: Annotated[
        str | None,
        typer.Option(help="With FMUs: connect them over a packet link of this name."),
    ] = None,
    fmus: FmusOption = FMUS,
    *,
    as_json: JsonOption = False,
) -> None:
    """Write a new scenario file with comments that explain each line.

    With FMUs after --from, every input is connected to the one output that matches it: by name, or
    by the name of a terminal and its member; in type and size; and in base units, with units
    converted. Inputs without a match, or with several, are listed and not connected.

    \b
    cosim scenario new mine
    cosim scenario new slower --from auv-acoustic
    cosim scenario new --from AuvPlant HinfController
    cosim scenario new lossy --from AuvPlant HinfController --link acoustic
    """
    bases, words = list(base or ()), list(names or ())
    if any(map(scenarios.is_fmu, bases)):
        words, parts = (
            [w for w in words if not scenarios.is_fmu(w)],
            [*bases, *filter(scenarios.is_fmu, words)],
        )
        if stray := [one for one in bases if not scenarios.is_fmu(one)]:
            expected = "FMUs, or one scenario"
            raise InputError("not an FMU", where="--from", expected=expected, got=stray[0])
        _new_from_fmus(_one_name(words), parts, link, fmus, as_json=as_json)
        return
    if link is not None:
        raise InputError("no FMUs to connect over it", where="--link", expected="--from with FMUs")
    if bases == [] and any(word.endswith(".fmu") for word in words):
        hint = f"cosim scenario new --from {' '.join(words)}"
        raise InputError("a scenario is not named after a file of an FMU", got=words[0], hint=hint)
    name = _one_name(words)
    if name is None:
        raise InputError("a scenario needs a name", expected="cosim scenario new NAME")
    if len(bases) > 1:
        raise InputError("a scenario extends one other", where="--from", got=", ".join(bases))
    path = _new_file(name)
    extended = bases[0] if bases else None
    write(path, scenarios.template(path.stem, extended))
    like = "a vehicle over an acoustic link" if extended is None else f"{extended} and what differs"
    answer(
        as_json,
        lambda: {"file": str(path), "extends": extended},
        line=f"written: {path}, {like}",
        tone="good",
        then=_to_do(path),
    )


def _one_name(words: list[str]) -> str | None:
    if len(words) > 1:
        hint = "the path of an FMU ends in .fmu"
        raise InputError("a scenario has one name", got=", ".join(words), hint=hint)
    return words[0] if words else None


def _new_file(name: str) -> Path:
    """Return the file of a new scenario, which is not there yet."""
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
    return path


def _new_from_fmus(
    name: str | None, parts: list[str], link: str | None, fmus: Path, *, as_json: bool
) -> None:
    """Write a scenario of FMUs and say what is wired."""
    path = _new_file(name or scenarios.default_name(parts))
    cache = make_fmu_cache(fmus, path.parent)
    made = scenarios.scenario_from_fmus(
        path.stem, parts, folder=path.parent, link=link, cache=cache
    )
    write(path, made.text)
    left = made.fitting.open_inputs
    answer(
        as_json,
        lambda: {
            "file": str(path),
            "fmus": made.fmus,
            "link": made.link,
            "inputs": made.fitting.inputs,
            "wired": [
                {"from": str(w.source), "to": str(w.target), "gain": w.gain, "offset": w.offset}
                for w in made.fitting.wires
            ],
            "not_wired": [
                {"input": str(x.target), "why": x.why, "possible": list(map(str, x.possible))}
                for x in left
            ],
            "problems": [problem.to_json() for problem in made.problems],
        },
        lambda: Group(
            *(Text(problem.text()) for problem in made.problems),
            *(Text(f"not wired: {one.target}: {one.why}") for one in left[:_MOST_OPEN]),
            *[Text(f"and {len(left) - _MOST_OPEN} more: {path}")] * (len(left) > _MOST_OPEN),
        ),
        line=f"written: {path}, {made.summary}",
        tone="bad" if made.problems else "open" if left else "good",
        then=_to_do(path),
    )
    if made.problems:
        raise typer.Exit(made.problems[0].exit_code)


_MOST_OPEN = 12
"""Inputs without a connection that are listed on a terminal."""


def _to_do(path: Path) -> tuple[str, ...]:
    return typed("scenario check", path), typed("run", path)


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
