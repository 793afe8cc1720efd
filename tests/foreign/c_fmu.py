"""FMUs in C as other exporters may write them, compiled by the tests."""

from __future__ import annotations

from pathlib import Path

from compiled import compile_fmu

TYPES = (
    *("Float64", "Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64"),
    *("UInt64", "Boolean", "String"),
)
"""Of FMI 3, in the order of every_fmi3.c."""


def c_fmu(source: str, description: str, folder: Path, *, text: str | None = None) -> Path:
    """Build the FMU of a C file beside this one; the test is skipped without a compiler.

    `text` is compiled in place of the file.
    """
    code = Path(__file__).with_name(source)
    if text is not None:
        code = folder / source
        code.write_text(text)
    return compile_fmu(code, description, folder / f"{code.stem}.fmu")


def source_of(name: str) -> str:
    """The text of a C file beside this one."""
    return Path(__file__).with_name(name).read_text("utf-8")


def talker(*, flags: str = "") -> str:
    """Model description of talker_fmi2.c, with further attributes of its CoSimulation."""
    variables = (
        ("u", "input", "continuous", '<Real start="0"/>'),
        ("y", "output", "continuous", "<Real/>"),
        ("greeting", "input", "discrete", '<String start="hello"/>'),
        ("reply", "output", "discrete", "<String/>"),
        ("mode", "parameter", "fixed", '<Integer start="0"/>'),
        ("b", "input", "discrete", '<Boolean start="false"/>'),
        ("level", "parameter", "tunable", '<Enumeration declaredType="Level" start="1"/>'),
        ("c", "output", "discrete", "<Boolean/>"),
    )
    lines = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}">{kind}</ScalarVariable>'
        for i, (name, causality, variability, kind) in enumerate(variables)
    )
    unknowns = "".join(f'<Unknown index="{i}"/>' for i in (2, 4, 8))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="2.0" modelName="talker" guid="{talker}" '
        'generationTool="A tool">'
        '<CoSimulation modelIdentifier="talker_fmi2" '
        f'canHandleVariableCommunicationStepSize="true" {flags}/>'
        '<TypeDefinitions><SimpleType name="Level"><Enumeration><Item name="low" value="1"/>'
        '<Item name="high" value="3"/></Enumeration></SimpleType></TypeDefinitions>'
        '<LogCategories><Category name="logMade"/><Category name="logStep"/></LogCategories>'
        f"<ModelVariables>{lines}</ModelVariables>"
        f"<ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>\n"
    )


def old(*, more: str = "") -> str:
    """Model description of old_fmi1.c, with further variables."""
    variables = (
        ("u", 0, "input", "continuous", '<Real start="0"/>'),
        ("x", 1, "output", "continuous", "<Real/><DirectDependency/>"),
        ("gain", 2, "internal", "parameter", '<Real start="1"/>'),
        ("gap", 3, "output", "continuous", "<Real/><DirectDependency/>"),
        ("n", 0, "input", "discrete", '<Integer start="0"/>'),
        (
            "m",
            0,
            "output",
            "discrete",
            "<Integer/><DirectDependency><Name>n</Name></DirectDependency>",
        ),
        ("mode", 1, "internal", "parameter", '<Integer start="0" min="0" max="9"/>'),
        ("repeated", 2, "output", "discrete", "<Integer/><DirectDependency/>"),
        ("tasks", 3, "output", "discrete", "<Integer/><DirectDependency/>"),
        ("b", 0, "input", "discrete", '<Boolean start="false"/>'),
        ("c", 1, "output", "discrete", "<Boolean/>"),
        ("s", 0, "input", "discrete", '<String start="old"/>'),
        ("t", 1, "output", "discrete", "<String/>"),
    )
    lines = "".join(
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}">{kind}</ScalarVariable>'
        for name, reference, causality, variability, kind in variables
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="1.0" modelName="old" modelIdentifier="old_fmi1" '
        'guid="{old}" numberOfContinuousStates="0" numberOfEventIndicators="0">'
        '<DefaultExperiment startTime="0" stopTime="2"/>'
        f"<ModelVariables>{lines}{more}</ModelVariables><Implementation>"
        "<CoSimulation_StandAlone><Capabilities "
        'canHandleVariableCommunicationStepSize="true" canHandleEvents="true"/>'
        "</CoSimulation_StandAlone></Implementation></fmiModelDescription>\n"
    )


def every(*, strings: bool = True) -> str:
    """Model description of every_fmi3.c, with or without its Strings and Binary."""
    lines = ['<Float64 name="time" valueReference="999" causality="independent"/>']
    outputs = []
    for place, kind in enumerate(TYPES):
        if kind == "String" and not strings:
            continue
        discrete = "" if kind.startswith("Float") else 'variability="discrete"'
        for slot, (name, causality) in enumerate(
            (("in", "input"), ("out", "output"), ("row", "input"), ("reversed", "output"))
        ):
            reference = 10 * place + slot
            dimensions = '<Dimension start="2"/>'
            if kind == "Float64":
                sizes = ('valueReference="200"', 'start="3"')
                ordered = sizes if causality == "input" else sizes[::-1]
                dimensions = "".join(f"<Dimension {size}/>" for size in ordered)
            start, texts = _start(kind) if causality == "input" else ("", "")
            lines.append(
                f'<{kind} name="{kind}.{name}" valueReference="{reference}" {start} {discrete} '
                f'causality="{causality}">{dimensions if slot > 1 else ""}{texts}</{kind}>'
            )
            if causality == "output":
                outputs.append(f'<Output valueReference="{reference}"/>')
    lines += [
        (
            '<UInt64 name="n" valueReference="200" causality="structuralParameter" '
            'variability="fixed" start="2" min="1" max="8"/>'
        ),
        *(
            f'<Float64 name="{name}" valueReference="{reference}" causality="parameter" '
            f'variability="{variability}" start="{start}"/>'
            for name, reference, variability, start in (
                ("end_at", 201, "fixed", 1e300),
                ("fail_at", 202, "fixed", 1e300),
                ("gain", 204, "tunable", 1),
            )
        ),
        (
            '<Int32 name="status" valueReference="203" causality="parameter" variability="fixed" '
            'start="3" min="0" max="5"/>'
        ),
        (
            '<Float64 name="x" valueReference="205" causality="output" initial="exact" start="5">'
            '<Alias name="state"/></Float64>'
        ),
        '<Float64 name="size" valueReference="206" causality="output"/>',
        '<Float64 name="seven" valueReference="207" causality="local" initial="exact" start="7"/>',
        *['<Binary name="blob" valueReference="300" causality="output"/>'] * strings,
        (
            '<Clock name="clock" valueReference="301" causality="output" variability="discrete" '
            'intervalVariability="triggered"/>'
        ),
        (
            '<Enumeration name="level" valueReference="208" causality="input" '
            'declaredType="Level" start="1"/>'
        ),
    ]
    outputs += ['<Output valueReference="205" dependencies=""/>']
    outputs += [f'<Output valueReference="{r}"/>' for r in (206, *[300] * strings, 301)]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<fmiModelDescription fmiVersion="3.0" modelName="every" instantiationToken="{every}">'
        '<CoSimulation modelIdentifier="every_fmi3" canGetAndSetFMUState="true" '
        'canSerializeFMUState="true" '
        'canHandleVariableCommunicationStepSize="true"/>'
        '<TypeDefinitions><EnumerationType name="Level"><Item name="low" value="1"/>'
        "</EnumerationType></TypeDefinitions>"
        '<LogCategories><Category name="made"/><Category name="bad"/></LogCategories>'
        f"<ModelVariables>{''.join(lines)}</ModelVariables>"
        f"<ModelStructure>{''.join(outputs)}</ModelStructure></fmiModelDescription>\n"
    )


def _start(kind: str) -> tuple[str, str]:
    """A start value as an attribute, or as elements."""
    if kind == "String":
        return "", '<Start value="a"/>'
    return f'start="{"false" if kind == "Boolean" else "0"}"', ""
