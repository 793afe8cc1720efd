"""Terminals and build descriptions: what their schemas cannot say."""

from __future__ import annotations

from pathlib import Path

import pytest
from fmu.packed import described, example, pack

from cosim.fmu.inspect import inspect_fmu

TERMINALS = "terminalsAndIcons/terminalsAndIcons.xml"
BUILD = "sources/buildDescription.xml"
ICON = "terminalsAndIcons/plug.png"
TERMINAL = """<?xml version="1.0" encoding="UTF-8"?>
<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals>
 <Terminal name="a" matchingRule="plug">
  <TerminalMemberVariable variableName="u" memberName="u" variableKind="signal"/>
  <TerminalMemberVariable variableName="y" memberName="y" variableKind="signal"/>
  <Terminal name="a" matchingRule="bus"/>
  <TerminalGraphicalRepresentation x1="0" y1="0" x2="1" y2="1" iconBaseName="plug"/>
 </Terminal>
 <Terminal name="b" matchingRule="none">
  <TerminalMemberVariable variableName="z" variableKind="signal"/></Terminal>
</Terminals></fmiTerminalsAndIcons>
"""
BUILT = """<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
 <BuildConfiguration modelIdentifier="Example" platform="x86_64-linux">
  <SourceFileSet compiler="gcc" compilerOptions="-O2"><SourceFile name="a.c"/></SourceFileSet>
 </BuildConfiguration>
 <BuildConfiguration modelIdentifier="Example">
  <SourceFileSet><SourceFile name="a.c"/></SourceFileSet>
 </BuildConfiguration>
</fmiBuildDescription>
"""


def codes(folder: Path, **files: str) -> set[str]:
    """The codes of errors and warnings, a missing binary apart."""
    packed = described(example("fmi3"), "documentation/index.html")
    packed |= {ICON: b"", "sources/a.c": b""}
    packed |= {TERMINALS: files.get("terminals", TERMINAL).encode()}
    packed |= {BUILD: files.get("build", BUILT).encode()}
    found = inspect_fmu(pack(packed, folder / "Example.fmu")).findings
    return {f.code for f in found if f.level != "note"} - {"binary-sources-only"}


def test_terminals_and_builds_without_fault_have_no_finding(tmp_path: Path) -> None:
    """A child has the name of its parent, a member is an alias."""
    assert codes(tmp_path) == set()


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('fmiVersion="3.0"', 'fmiVersion="3.0.1"', "terminal-version"),
        ('name="b"', 'name="a"', "terminal-twice"),
        ('variableName="u"', 'variableName="gone"', "terminal-member"),
        ('variableName="u"', 'variableName="x"', "terminal-member"),
        ('memberName="u"', 'memberName="y"', "terminal-member"),
        (' memberName="u"', "", "terminal-member"),
        ('iconBaseName="plug"', 'iconBaseName="socket"', "terminal-icon"),
    ],
)
def test_fault_of_a_terminal_gives_its_finding(
    tmp_path: Path, old: str, new: str, code: str
) -> None:
    """Names, members and pictures."""
    assert codes(tmp_path, terminals=TERMINAL.replace(old, new, 1)) == {code}


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('modelIdentifier="Example" ', 'modelIdentifier="Other" ', "build-identifier"),
        (' platform="x86_64-linux"', "", "build-twice"),
        ('compiler="gcc" ', "", "build-compiler"),
    ],
)
def test_fault_of_a_build_gives_its_finding(tmp_path: Path, old: str, new: str, code: str) -> None:
    """Identifiers, platforms and compilers."""
    assert codes(tmp_path, build=BUILT.replace(old, new, 1)) == {code}
