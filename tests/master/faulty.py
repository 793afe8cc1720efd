"""Builds the FMU of faulty.c, of FMI 2.0 or 3.0."""

from __future__ import annotations

from pathlib import Path

from compiled import compile_fmu

CALLS = ("nothing", "step", "get", "set", "enter", "exit", "terminate", "free")
"""Value of fail_in, by place."""

_2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="{name}" guid="{name}">
<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
<LogCategories><Category name="logAll"/></LogCategories>
<ModelVariables>
<ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
<ScalarVariable name="x" valueReference="1" causality="output"><Real/></ScalarVariable>
<ScalarVariable name="fail_in" valueReference="2" causality="parameter" variability="fixed">
<Integer start="0"/></ScalarVariable>
<ScalarVariable name="status" valueReference="3" causality="parameter" variability="fixed">
<Integer start="0"/></ScalarVariable>
<ScalarVariable name="fail_at" valueReference="4" causality="parameter" variability="fixed">
<Real start="0"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2" dependencies=""/></Outputs>
<InitialUnknowns><Unknown index="2" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
_3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="{name}" instantiationToken="{name}">
<CoSimulation modelIdentifier="{name}" canHandleVariableCommunicationStepSize="true"/>
<LogCategories><Category name="logAll"/></LogCategories>
<ModelVariables>
<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>
<Float64 name="u" valueReference="0" causality="input" start="0"/>
<Float64 name="x" valueReference="1" causality="output"/>
<Int32 name="fail_in" valueReference="2" causality="parameter" variability="fixed" start="0"/>
<Int32 name="status" valueReference="3" causality="parameter" variability="fixed" start="0"/>
<Float64 name="fail_at" valueReference="4" causality="parameter" variability="fixed" start="0"/>
</ModelVariables>
<ModelStructure><Output valueReference="1" dependencies=""/>
<InitialUnknown valueReference="1" dependencies=""/></ModelStructure>
</fmiModelDescription>
"""


def faulty_fmu(folder: Path, version: str, name: str) -> Path:
    """name.fmu, compiled by the system's compiler; FMUs of two names are two FMUs."""
    description = (_2 if version == "2.0" else _3).format(name=name)
    return compile_fmu(Path(__file__).with_name("faulty.c"), description, folder / f"{name}.fmu")
