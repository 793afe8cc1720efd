"""The sub-commands of `cosim`, each loaded when it is used: loading all takes seconds."""

from __future__ import annotations

import importlib
from typing import Any, ClassVar, NamedTuple

import typer

from cosim.cli.help_text import HelpCommand, HelpGroup, HelpTyper


class Verb(NamedTuple):
    """Where a sub-command stands: the module, its function or group, and its line in the help."""

    module: str
    member: str
    help: str
    hidden: bool = False


VERBS = {
    "demo": Verb(
        "run",
        "demo",
        "Fly two designs with the same late position fixes and compare them in one picture.",
    ),
    "design": Verb(
        "design",
        "design",
        "Design an H-infinity state feedback for a system with delays, and prove it exactly.",
    ),
    "analyse": Verb(
        "design",
        "analyse",
        "Analyse the loop with a given gain, or the system without control, and prove the result.",
    ),
    "age": Verb(
        "age", "age", "Compute how old the messages of a loop may be, and what each age costs."
    ),
    "paper": Verb(
        "paper",
        "paper",
        "Compute each equation chain, table and figure of the paper; compare with the printed one.",
    ),
    "run": Verb("run", "run", "Run a scenario and write its trace."),
    # older name of `scenario list`
    "scenarios": Verb("scenario", "list_scenarios", "List the built-in scenarios.", hidden=True),
    "scenario": Verb(
        "scenario", "scenario_app", "List, create, check and show scenarios (TOML files)."
    ),
    "trace": Verb(
        "trace",
        "trace_app",
        "Read, verify, recover, compare, show, export and rerun recorded traces.",
    ),
    "link": Verb(
        "link",
        "link_app",
        "Record links from traces, show what became of their messages, fit models, "
        "and judge links by a proof.",
    ),
    "certificate": Verb(
        "certificate",
        "certificate_app",
        "Check the certificate of a design or an analysis; prove its gains for other ages.",
    ),
    "fmu": Verb(
        "fmu",
        "fmu_app",
        "Export a plant or a controller as an FMU; inspect or check any FMU.",
    ),
    "ssp": Verb(
        "ssp",
        "ssp_app",
        "Export a scenario as an SSP archive, import an archive, or check one.",
    ),
    "vehicle": Verb(
        "vehicle",
        "vehicle_app",
        "Create, check, show and fly a vehicle from its parameters: design, proof and simulation.",
    ),
    "study": Verb(
        "study",
        "study_app",
        "Run one scenario many times: over grids, random samples or seeds; on cores or a cluster.",
    ),
    "migrate": Verb(
        "migrate",
        "migrate",
        "Bring files to the newest version of their keys, and write that version into them.",
    ),
}

TRACE_VERBS = {
    "export": Verb(
        "trace_export",
        "export",
        "Write the signals of a trace as CSV or Parquet tables, a MATLAB file or a ROS 2 bag.",
    ),
    "layout": Verb(
        "trace_layout",
        "layout",
        "Write a layout with which a viewer shows a trace: scene, log, and plots with their units.",
    ),
    "diff": Verb(
        "trace_diff",
        "diff",
        "Compare two traces: which signal differs first, when, and by how much.",
    ),
    "rerun": Verb(
        "trace_rerun",
        "rerun",
        "Repeat a run from its trace alone and compare the two (exit code 1 if they differ).",
    ),
    "inject": Verb(
        "trace_inject",
        "inject",
        "Feed recorded signals into one FMU and record its outputs in a new trace.",
    ),
}
"""Those of `trace` that need more than its reader."""

STYLE: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
}
"""Of every typer application here."""


class VerbsOnUse(HelpGroup):
    """A group that lists `verbs` after its own commands, and loads the one that is called."""

    verbs: ClassVar[dict[str, Verb]] = VERBS

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        for name, verb in self.verbs.items():
            self.add_command(HelpCommand(name, help=verb.help, hidden=verb.hidden))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Load the command that is named, then find it as usual."""
        if args[0] in self.verbs:
            self.add_command(loaded(args[0], self.verbs[args[0]]))
        return super().resolve_command(ctx, args)


class TraceVerbs(VerbsOnUse):
    """The commands of `cosim trace`."""

    verbs = TRACE_VERBS


def loaded(name: str, verb: Verb) -> Any:
    """Return the command of this name, its module loaded."""
    member = getattr(importlib.import_module(f"cosim.cli.{verb.module}"), verb.member)
    around = HelpTyper(**STYLE)
    if isinstance(member, typer.Typer):
        around.add_typer(member, name=name)
    else:
        around.command(name, hidden=verb.hidden)(member)
    around.callback()(lambda: None)  # a group, though of one command
    group: Any = typer.main.get_command(around)
    return group.commands[name]
