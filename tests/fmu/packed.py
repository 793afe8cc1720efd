"""FMUs made on the fly: taken apart, damaged in one place, packed again."""

from __future__ import annotations

import re
import shutil
import subprocess
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import fmpy
import pytest

from cosim.fmu.inspect import RULES, Inspection, inspect_fmu

XML = "modelDescription.xml"
Files = dict[str, bytes]
Damage = Callable[[Files], None]

FMI1 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="1.0" modelName="Old" modelIdentifier="Old" guid="{1}"
 numberOfContinuousStates="0" numberOfEventIndicators="0">
 <ModelVariables>
  <ScalarVariable name="u" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
  <ScalarVariable name="y" valueReference="1" causality="output"><Real/></ScalarVariable>
 </ModelVariables>
 <Implementation><CoSimulation_StandAlone><Capabilities
   canHandleVariableCommunicationStepSize="true" canHandleEvents="false"/>
 </CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""

FMI3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="New" instantiationToken="{1}"
 variableNamingConvention="structured">
 <ModelExchange modelIdentifier="New"/>
 <CoSimulation modelIdentifier="New" canGetAndSetFMUState="true"/>
 <ScheduledExecution modelIdentifier="New"/>
 <UnitDefinitions>
  <Unit name="m"><BaseUnit m="1"/></Unit>
  <Unit name="s"><BaseUnit s="1"/></Unit>
 </UnitDefinitions>
 <ModelVariables>
  <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
  <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="fixed"
   start="2"/>
  <Float64 name="u" valueReference="2" causality="input" start="0 0" unit="m">
   <Dimension valueReference="1"/></Float64>
  <Float64 name="x" valueReference="3" causality="local" initial="exact" start="1" unit="m"/>
  <Float64 name="der(x)" valueReference="4" causality="local" derivative="3"/>
  <Float64 name="y" valueReference="5" causality="output" initial="exact" start="1" unit="m"/>
 </ModelVariables>
 <ModelStructure>
  <Output valueReference="5" dependencies="2 3"/>
  <ContinuousStateDerivative valueReference="4" dependencies="2"/>
  <InitialUnknown valueReference="4"/>
 </ModelStructure>
</fmiModelDescription>
"""


def example(base: str) -> str:
    """The model description without faults, "fmi1", "fmi2" or "fmi3", that rules show faults of."""
    if base == "fmi1":  # no rule shows a fault of one
        return FMI1.replace("Old", "Example")
    return next(
        rule.broken().replace(rule.new, rule.old)
        for rule in RULES.values()
        if rule.base == base and rule.new and rule.broken().count(rule.new) == 1
    )


def inspected(xml: str, folder: Path) -> Inspection:
    """The inspection of a model description: of an FMU with nothing else but a source."""
    files = {XML: xml.encode(), "sources/a.c": b""}
    return inspect_fmu(pack(files, folder / "described.fmu"))


def functions_of_fmi2() -> list[str]:
    """The functions of FMI 2.0 for co-simulation, by the header of the standard in FMPy."""
    text = (Path(fmpy.__file__).parent / "c-code" / "fmi2Functions.h").read_text("utf-8")
    exchange = text.rfind("Functions for FMI2 for Model Exchange")
    text = text[:exchange] + text[text.rfind("FMI2 for Co-Simulation") :]
    return sorted(set(re.findall(r"_Export fmi2\w+TYPE\s+(\w+);", text)))


def described(xml: str, page: str) -> Files:
    """A description with its page and a source, no binary."""
    return {XML: xml.encode(), page: b"<html></html>"}


def files_of(path: Path) -> Files:
    """Every file of an FMU."""
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def pack(files: Mapping[str, bytes], target: Path) -> Path:
    """Write an FMU."""
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return target


def described_as(*changes: tuple[str, str]) -> Damage:
    """Changes of the XML, each pattern found and replaced once."""

    def apply(files: Files) -> None:
        text = files[XML].decode()
        for pattern, replacement in changes:
            text, times = re.subn(pattern, replacement, text, count=1, flags=re.DOTALL)
            assert times == 1, pattern
        files[XML] = text.encode()

    return apply


def renamed(old: str, new: str) -> Damage:
    """Move every file whose path begins with `old`."""

    def apply(files: Files) -> None:
        found = [name for name in files if name.startswith(old)]
        assert found
        for name in found:
            files[new + name.removeprefix(old)] = files.pop(name)

    return apply


def without(start: str) -> Damage:
    """Leave out every file whose path begins so."""

    def apply(files: Files) -> None:
        found = [name for name in files if name.startswith(start)]
        assert found
        for name in found:
            del files[name]

    return apply


def with_file(name: str, content: bytes) -> Damage:
    """Add a file, or replace it."""

    def apply(files: Files) -> None:
        files[name] = content

    return apply


def compiled(folder: Path, source: str, name: str, *options: str) -> Path:
    """A shared library of C; the test is skipped where there is no compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("needs a C compiler")
    code, library = folder / f"{name}.c", folder / f"{name}.so"
    code.write_text(source)
    line = [compiler, "-shared", "-fPIC", "-O0", "-w", str(code), "-o", str(library)]
    line += options
    subprocess.run(line, check=True, capture_output=True)  # noqa: S603 - a compiler
    return library
