"""Builds FMUs of events.c with the variables that a test needs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from compiled import compile_fmu

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
_VARIABLES = {
    "alarm": '<Clock name="alarm" valueReference="2" causality="input" '
    'intervalVariability="countdown"/>',
    "trigger": '<Clock name="trigger" valueReference="3" causality="input" '
    'intervalVariability="triggered"/>',
    "fired": '<Clock name="fired" valueReference="4" causality="output" '
    'intervalVariability="triggered"/>',
    "ticks": '<Int32 name="ticks" valueReference="10" causality="output" clocks="1"/>',
    "alarms": '<Int32 name="alarms" valueReference="11" causality="output" clocks="2"/>',
    "triggers": '<Int32 name="triggers" valueReference="12" causality="output" clocks="3"/>',
    "limit": '<Int32 name="limit" valueReference="13" causality="parameter" '
    'variability="fixed" start="5"/>',
    "u": '<Int32 name="u" valueReference="20" causality="input" start="0"/>',
    "y": '<Int32 name="y" valueReference="21" causality="output"/>',
    "x": '<Float64 name="x" valueReference="30" causality="input" start="0"/>',
    "sampled": '<Float64 name="sampled" valueReference="31" causality="output" clocks="1" '
    'variability="discrete"/>',
    "z": '<Float64 name="z" valueReference="38" causality="input" variability="discrete" '
    'clocks="3" start="0"/>',
    "ramp": '<Float64 name="ramp" valueReference="32" causality="output" '
    'intermediateUpdate="true"/>',
    "message": '<Binary name="message" valueReference="40" causality="input">'
    '<Start value=""/></Binary>',
    "echo": '<Binary name="echo" valueReference="41" causality="output"/>',
    "n": '<UInt64 name="n" valueReference="50" causality="structuralParameter" '
    'variability="fixed" start="2"/>',
    "row": '<Float64 name="row" valueReference="51" causality="input" start="1">'
    '<Dimension valueReference="50"/></Float64>',
    "doubled": '<Float64 name="doubled" valueReference="52" causality="output">'
    '<Dimension valueReference="50"/></Float64>',
    **{
        name: f'<Float64 name="{name}" valueReference="{33 + i}" causality="parameter" '
        f'variability="fixed" start="{start}"/>'
        for i, (name, start) in enumerate(
            (
                ("event_at", "1e300"),
                ("alarm_after", "1e300"),
                ("stop_early", "1e300"),
                ("growth", "1"),
                ("interval", "0.1"),
            )
        )
    },
}
_DEPENDENCIES = {
    "fired": ("tick", "trigger"),
    "ticks": ("tick",),
    "alarms": ("alarm",),
    "triggers": ("trigger",),
    "sampled": ("tick", "x"),
    "echo": ("message",),
    "doubled": ("row",),
    "y": (),
    "ramp": (),
}


def _reference(text: str) -> str:
    return text.split('valueReference="')[1].split('"', maxsplit=1)[0]


def event_fmu(
    folder: Path,
    names: Iterable[str],
    tick: str = "",
    *,
    state: bool = True,
    scheduled: bool = False,
    types: str = "",
    terminals: str = "",
) -> Path:
    """Make an FMU with these variables; `tick` : attributes of the Clock of that name.

    `state` : it can save its state; `scheduled` : it is for scheduled execution; `types` : the
    types that it defines; `terminals` : its file of terminals.
    """
    chosen = {name: _VARIABLES[name] for name in names}
    if tick:
        clock = f'<Clock name="tick" valueReference="1" causality="input" {tick}/>'
        chosen = {"tick": clock, **chosen}
    outputs = ""
    for name, text in chosen.items():
        if 'causality="output"' in text:
            on = " ".join(_reference(chosen[d]) for d in _DEPENDENCIES[name] if d in chosen)
            outputs += f'<Output valueReference="{_reference(text)}" dependencies="{on}"/>'
    able = 'canGetAndSetFMUState="true"' if state else ""
    interface = (
        f'<CoSimulation modelIdentifier="events" hasEventMode="true" {able} '
        'canHandleVariableCommunicationStepSize="true" providesIntermediateUpdate="true" '
        'mightReturnEarlyFromDoStep="true"/>'
    )
    if scheduled:
        interface = '<ScheduledExecution modelIdentifier="events"/>'
    description = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="3.0" modelName="events" instantiationToken="{e}">'
        f"{interface}{f'<TypeDefinitions>{types}</TypeDefinitions>' if types else ''}"
        '<ModelVariables><Float64 name="time" valueReference="0" causality="independent" '
        f'variability="continuous"/>{"".join(chosen.values())}</ModelVariables>'
        f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>\n"
    )
    number = len(list(folder.glob("*.fmu")))
    source, path = Path(__file__).with_name("events.c"), folder / f"e{number}.fmu"
    return compile_fmu(source, description, path, files={TERMINALS: terminals} if terminals else {})
