"""Random FMUs without code: model descriptions and terminals, and the same as plain data."""

from __future__ import annotations

import random
import zipfile
from pathlib import Path

from truth.wiring import Model, Terminal, Variable

NAMES = ("x", "y", "q[1]", "speed over ground", "g->h")
TYPES = {
    "1.0": ("Real", "Real", "Integer", "Boolean", "String"),
    "2.0": ("Real", "Real", "Integer", "Boolean", "String"),
    "3.0": ("Float64", "Float64", "Float32", "Int32", "UInt8", "Int64", "Boolean", "String"),
}
UNITS = (*[None] * 4, *["m"] * 3, *["cm"] * 2, "K", "degC", "rad", "quux")
BASES = {"length": "m", "temperature": "K", "angle": "rad"}
DEFINITIONS = {
    "m": [("length", 1.0, 0.0), ("length", 1.0, 0.0), ("length", 0.3048, 0.0)],
    "cm": [("length", 0.01, 0.0)],
    "K": [("temperature", 1.0, 0.0)],
    "degC": [("temperature", 1.0, 273.15)],
    "rad": [("angle", 1.0, 0.0)],
    "quux": [("length", 2.5, 0.0), ("temperature", 1.0, 0.0)],
}


def random_model(draw: random.Random, version: str) -> Model:
    """Variables of few names, most of them real numbers, so that many of them meet."""
    taken = draw.sample(NAMES, draw.randint(3, len(NAMES)))
    variables = []
    for name in taken:
        kind = TYPES[version][0] if draw.random() < 0.7 else draw.choice(TYPES[version])
        number = kind in ("Real", "Float64", "Float32")
        shape = draw.choice([*[()] * 8, (1,), (2,), (2, 1)]) if version == "3.0" else ()
        unit = draw.choice(UNITS) if number else None
        causality = draw.choice(["input", "input", "output", "output", "output", "local"])
        variables.append(Variable(name, causality, kind, shape, unit))
    units = {
        unit: draw.choice(DEFINITIONS[unit])
        for unit in sorted({v.unit for v in variables if v.unit})
        if version != "1.0" and draw.random() < 0.7  # FMI 1 has no base units
    }
    terminals = []
    ends = [v.name for v in variables if v.causality != "local"]
    for name in draw.sample(["t", "s"], draw.choice([0, 2, 2])):
        pool = ends if ends and draw.random() < 0.9 else taken
        chosen = draw.sample(pool, min(draw.choice([1, 1, 1, 2, 3]), len(pool)))
        members = list(zip("abc", chosen, strict=False))
        rule = draw.choice(["plug", "bus", "bus", "bus", "sequence"])
        terminals.append(Terminal(name, rule, draw.choice([*[None] * 6, "k"]), members))
    return Model(variables, units, terminals)


def written(model: Model, version: str, path: Path) -> Path:
    """The FMU of a model; it has no binary."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", _description(model, version))
        if model.terminals:
            archive.writestr("terminalsAndIcons/terminalsAndIcons.xml", _terminals(model, version))
    return path


def _quoted(text: str) -> str:
    return text.replace("&", "&amp;").replace(">", "&gt;").replace('"', "&quot;")


def _description(model: Model, version: str) -> str:
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription'
    units = "".join(
        f'<Unit name="{name}"><BaseUnit {BASES[base]}="1" factor="{factor}" offset="{offset}"/>'
        "</Unit>"
        for name, (base, factor, offset) in model.units.items()
    )
    units = f"<UnitDefinitions>{units}</UnitDefinitions>" if units else ""
    lines = [_variable(v, place, version) for place, v in enumerate(model.variables, 1)]
    outputs = [i for i, v in enumerate(model.variables, 1) if v.causality == "output"]
    body = f"<ModelVariables>{''.join(lines)}</ModelVariables>"
    if version == "1.0":
        return (
            f'{head} fmiVersion="1.0" modelName="a" modelIdentifier="a" guid="{{a}}" '
            f'numberOfContinuousStates="0" numberOfEventIndicators="0">{body}<Implementation>'
            "<CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation>"
            "</fmiModelDescription>"
        )
    if version == "2.0":
        listed = "".join(f'<Unknown index="{i}" dependencies=""/>' for i in outputs)
        return (
            f'{head} fmiVersion="2.0" modelName="a" guid="{{a}}"><CoSimulation '
            f'modelIdentifier="a" canHandleVariableCommunicationStepSize="true"/>{units}{body}'
            f"<ModelStructure>{f'<Outputs>{listed}</Outputs>' if listed else ''}</ModelStructure>"
            "</fmiModelDescription>"
        )
    listed = "".join(f'<Output valueReference="{i}" dependencies=""/>' for i in outputs)
    time = '<Float64 name="time" valueReference="999" causality="independent"/>'
    body = body.replace("<ModelVariables>", f"<ModelVariables>{time}")
    return (
        f'{head} fmiVersion="3.0" modelName="a" instantiationToken="{{a}}"><CoSimulation '
        f'modelIdentifier="a"/>{units}{body}<ModelStructure>{listed}</ModelStructure>'
        "</fmiModelDescription>"
    )


def _variable(v: Variable, place: int, version: str) -> str:
    real = v.type in ("Real", "Float64", "Float32")
    variability = "continuous" if real else "discrete"
    common = f'name="{_quoted(v.name)}" valueReference="{place}"'
    unit = f' unit="{v.unit}"' if v.unit else ""
    count = 1
    for extent in v.shape:
        count *= extent
    value = {"Boolean": "false", "String": "a"}.get(v.type, "0")
    start = f' start="{value}"' if v.causality == "input" else ""
    if version != "3.0":
        causality = "internal" if (version, v.causality) == ("1.0", "local") else v.causality
        return (
            f'<ScalarVariable {common} causality="{causality}" variability="{variability}">'
            f"<{v.type}{start}{unit}/></ScalarVariable>"
        )
    inner = "".join(f'<Dimension start="{extent}"/>' for extent in v.shape)
    if v.type == "String" and start:
        inner, start = inner + '<Start value="a"/>' * count, ""
    elif start:
        start = f' start="{" ".join([value] * count)}"'
    return (
        f'<{v.type} {common} causality="{v.causality}" variability="{variability}"{start}{unit}>'
        f"{inner}</{v.type}>"
    )


def _terminals(model: Model, version: str) -> str:
    lines = []
    for one in model.terminals:
        kind = f' terminalKind="{one.kind}"' if one.kind else ""
        members = "".join(
            f'<TerminalMemberVariable variableKind="signal" variableName="{_quoted(variable)}" '
            f'memberName="{member}"/>'
            for member, variable in one.members
        )
        lines.append(
            f'<Terminal name="{one.name}" matchingRule="{one.rule}"{kind}>{members}</Terminal>'
        )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<fmiTerminalsAndIcons fmiVersion="{version}">'
        f"<Terminals>{''.join(lines)}</Terminals></fmiTerminalsAndIcons>"
    )
