"""Every kind of damage gives its own finding, at its level, and never a traceback."""

from __future__ import annotations

import struct
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmu.packed import (
    FMI1,
    FMI3,
    XML,
    Damage,
    described,
    described_as,
    files_of,
    pack,
    renamed,
    with_file,
    without,
)
from shared import sampled, spread

from cosim.core import InputError
from cosim.fmu.export import CATALOGUE
from cosim.fmu.inspect import RULES, inspect_fmu

CONTAINER = Path(fmpy.__file__).parent / "container_fmu" / "binaries"
SO, DLL = "binaries/linux64/AuvPlant.so", "binaries/win64/AuvPlant.dll"
ETA_X = r'(<ScalarVariable name="eta\.x".*?<Real [^/]*?)'


def found(path: Path) -> dict[str, str]:
    """Code -> level of the gravest finding of it."""
    levels: dict[str, str] = {}
    for each in inspect_fmu(path).findings:
        assert each.why
        assert each.what
        levels.setdefault(each.code, each.level)
    return levels


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_built_in_fmus_have_neither_errors_nor_warnings(fmus: Path, name: str) -> None:
    """Only notes are left: a Python host is needed and declared."""
    levels = found(fmus / f"{name}.fmu")
    assert set(levels.values()) == {"note"}
    assert {"needs-python", "needs-tool"} <= set(levels)
    assert inspect_fmu(fmus / f"{name}.fmu").valid


@pytest.mark.parametrize(
    ("xml", "page", "allowed"),
    [
        (FMI1, "documentation/_main.html", {"binary-none"}),
        (FMI3, "documentation/index.html", {"binary-none"}),
    ],
)
def test_undamaged_bases_only_lack_a_binary(
    tmp_path: Path, xml: str, page: str, allowed: set[str]
) -> None:
    """Before they are damaged, the FMUs of FMI 1 and 3 have no other finding."""
    path = pack(described(xml, page), tmp_path / "base.fmu")
    assert set(found(path)) == allowed


FMI2_DAMAGE: dict[str, tuple[Damage, str, str]] = {
    "backslash": (renamed("documentation/", "documentation\\"), "path-backslash", "error"),
    "parent": (with_file("../outside.txt", b""), "path-escapes", "error"),
    "inner-parent": (with_file("resources/../../outside.txt", b""), "path-escapes", "error"),
    "absolute": (with_file("/etc/outside.txt", b""), "path-escapes", "error"),
    "drive": (with_file("C:/outside.txt", b""), "path-escapes", "error"),
    "control": (with_file("resources/a\nb", b""), "path-control", "error"),
    "case": (with_file("Documentation/index.html", b""), "entry-case", "error"),
    "malformed": (described_as((r"<ModelVariables>", "<ModelVariables")), "xml-malformed", "error"),
    "empty-xml": (with_file(XML, b""), "xml-malformed", "error"),
    "binary-xml": (with_file(XML, bytes(range(256))), "xml-malformed", "error"),
    "doctype": (
        described_as(
            (r"<fmiModelDescription ", '<!DOCTYPE x [<!ENTITY a "b">]><fmiModelDescription ')
        ),
        "xml-doctype",
        "error",
    ),
    "other-xml": (with_file(XML, b"<html/>"), "xml-schema", "error"),
    "version": (
        described_as((r'fmiVersion="2\.0"', 'fmiVersion="2.1"')),
        "version-unknown",
        "error",
    ),
    "no-version": (described_as((r'fmiVersion="2\.0"', "")), "version-unknown", "error"),
    "attribute": (
        described_as((r'modelName="', 'modelname="x" modelName="')),
        "xml-schema",
        "error",
    ),
    "causality": (described_as((r'causality="input"', 'causality="inlet"')), "xml-schema", "error"),
    "no-kind": (described_as((r"<CoSimulation [^>]*/>", "")), "kind-none", "error"),
    "no-variables": (
        described_as((r"<ModelVariables>.*</ModelVariables>", "")),
        "xml-schema",
        "error",
    ),
    "identifier": (
        described_as((r'modelIdentifier="AuvPlant"', 'modelIdentifier="1 plant"')),
        "identifier",
        "error",
    ),
    "token": (described_as((r'guid="[^"]*"', 'guid=""')), "token-empty", "warning"),
    "name-twice": (described_as((r'name="eta\.y"', 'name="eta.x"')), "name-twice", "error"),
    "name": (described_as((r'name="eta\.y"', 'name="eta..y"')), "name-structure", "error"),
    "name-tab": (described_as((r'name="eta\.y"', 'name="eta&#9;y"')), "name-control", "error"),
    "start-missing": (
        described_as((r'(name="force\.x".*?) start="[^"]*"', r"\1")),
        "start-missing",
        "error",
    ),
    "start-superfluous": (
        described_as((r'(name="eta\.x"[^>]*)initial="exact"', r'\1initial="calculated"')),
        "start-superfluous",
        "error",
    ),
    "start-nan": (
        described_as((r'(name="eta\.x".*?start=)"[^"]*"', r'\1"NaN"')),
        "start-number",
        "error",
    ),
    "start-range": (described_as((ETA_X, r'\1min="1" max="2" ')), "start-range", "error"),
    "range": (described_as((ETA_X, r'\1min="3" max="2" ')), "range-empty", "error"),
    "nominal": (described_as((ETA_X, r'\1nominal="0" ')), "nominal", "warning"),
    "initial": (
        described_as((r'(causality="parameter"[^>]*)initial="exact"', r'\1initial="calculated"')),
        "combination",
        "error",
    ),
    "variability": (
        described_as((r'(name="force\.x"[^>]*variability=)"continuous"', r'\1"fixed"')),
        "combination",
        "error",
    ),
    "type": (described_as((ETA_X, r'\1declaredType="Nothing" ')), "type-undefined", "error"),
    "reference-types": (
        described_as(
            (
                r"</ModelVariables>",
                (
                    '<ScalarVariable name="i" valueReference="1"><Integer/></ScalarVariable>'
                    "</ModelVariables>"
                ),
            )
        ),
        "reference-types",
        "note",
    ),
    "alias-unit": (
        described_as((r'(name="eta\.psi" valueReference=)"\d+"', r'\1"8"')),
        "alias-unit",
        "error",
    ),
    "alias-settable": (
        described_as((r'(name="force\.y" valueReference=)"\d+"', r'\1"1"')),
        "alias-settable",
        "error",
    ),
    "unit-undefined": (
        described_as((r'<Unit name="N\.m">', '<Unit name="N m">')),
        "unit-undefined",
        "error",
    ),
    "unit-twice": (
        described_as((r"</UnitDefinitions>", '<Unit name="N"/></UnitDefinitions>')),
        "unit-twice",
        "error",
    ),
    "unit-display": (
        described_as((ETA_X, r'\1displayUnit="furlong" ')),
        "unit-display",
        "warning",  # FMI 2 ignores it
    ),
    "unit-open": (
        described_as((r'(<Unit name="N">)\s*<BaseUnit [^/]*/>', r"\1")),
        "unit-open",
        "note",
    ),
    "unit-none": (described_as((r'(name="eta\.x".*?) unit="m"', r"\1")), "unit-none", "note"),
    "experiment": (
        described_as((r'(startTime=)"0\.0"( stopTime=)"[^"]*"', r'\1"2"\2"1"')),
        "experiment",
        "warning",
    ),
    "step": (described_as((r'stepSize="[^"]*"', 'stepSize="-0.1"')), "experiment", "warning"),
    "derivative": (described_as((ETA_X, r'\1derivative="999" ')), "derivative", "error"),
    "outputs": (described_as((r'<Unknown index="9"[^/]*/>', "")), "structure-outputs", "error"),
    "not-an-output": (
        described_as((r'<Unknown index="9"', '<Unknown index="1"')),
        "structure-outputs",
        "error",
    ),
    "structure-dangling": (
        described_as((r'<Unknown index="9"', '<Unknown index="999"')),
        "structure-dangling",
        "error",
    ),
    "dependency-dangling": (
        described_as(
            (
                r'dependencies="" dependenciesKind=""',
                'dependencies="999" dependenciesKind="dependent"',
            )
        ),
        "dependency-dangling",
        "error",
    ),
    "dependency-kind": (
        described_as(
            (
                r'dependencies="" dependenciesKind=""',
                'dependencies="1 2" dependenciesKind="dependent"',
            )
        ),
        "dependency-kind",
        "error",
    ),
    "dependency-known": (
        described_as(
            (
                r'dependencies="" dependenciesKind=""',
                'dependencies="10" dependenciesKind="dependent"',
            )
        ),
        "dependency-known",
        "warning",
    ),
    "dependency-open": (
        described_as((r' dependencies="" dependenciesKind=""', "")),
        "dependency-open",
        "note",
    ),
    "initial-unknowns": (
        described_as(
            (r"</Outputs>", '</Outputs><InitialUnknowns><Unknown index="9"/></InitialUnknowns>')
        ),
        "structure-initial",
        "error",
    ),
    "no-binaries": (without("binaries/"), "binary-none", "error"),
    "sources-only": (renamed("binaries/", "sources/"), "binary-sources-only", "warning"),
    "not-here": (without("binaries/linux64"), "binary-here", "warning"),
    "binary-name": (renamed(SO, "binaries/linux64/Other.so"), "binary-name", "error"),
    "binary-case": (renamed(DLL, "binaries/win64/auvplant.dll"), "binary-name", "warning"),
    "binary-folder": (renamed("binaries/win64", "binaries/Win64"), "binary-folder", "warning"),
    "binary-tuple": (
        renamed("binaries/win64", "binaries/x86_64-windows"),
        "binary-folder-tuple",
        "note",
    ),
    "binary-text": (with_file(SO, b"#!/bin/sh\n"), "binary-damaged", "error"),
    "binary-empty": (with_file(SO, b""), "binary-damaged", "error"),
    "binary-cut": (with_file(SO, b"\x7fELF\x02\x01\x01" + bytes(20)), "binary-damaged", "error"),
    "needs-python": (
        described_as((r'needsExecutionTool="true"', 'needsExecutionTool="false"')),
        "needs-python",
        "warning",
    ),
    "once": (
        described_as(
            (
                r'canBeInstantiatedOnlyOncePerProcess="false"',
                'canBeInstantiatedOnlyOncePerProcess="true"',
            )
        ),
        "once-per-process",
        "note",
    ),
    "sources": (
        described_as(
            (
                r"(<CoSimulation [^>]*)/>",
                r'\1><SourceFiles><File name="a.c"/></SourceFiles></CoSimulation>',
            )
        ),
        "sources-missing",
        "error",
    ),
    "unlisted": (with_file("sources/a.c", b""), "sources-unlisted", "warning"),
    "documentation": (without("documentation/"), "documentation", "note"),
}


@pytest.mark.parametrize("name", sampled(spread(FMI2_DAMAGE, 2), 34))
def test_damage_of_an_fmi2_fmu_gives_its_finding(fmus: Path, tmp_path: Path, name: str) -> None:
    """Each change of AuvPlant gives its finding at its level."""
    damage, code, level = FMI2_DAMAGE[name]
    files = files_of(fmus / "AuvPlant.fmu")
    damage(files)
    assert found(pack(files, tmp_path / "damaged.fmu")).get(code) == level


FMI3_DAMAGE: dict[str, tuple[Damage, str, str]] = {
    "reference-twice": (
        described_as((r'valueReference="4"', 'valueReference="3"')),
        "reference-twice",
        "error",
    ),
    "no-time": (described_as((r"<Float64 name=\"time\"[^>]*/>", "")), "independent", "error"),
    "dimension": (
        described_as((r"<Dimension valueReference=\"1\"", '<Dimension valueReference="77"')),
        "dimension",
        "error",
    ),
    "start-length": (described_as((r'start="0 0"', 'start="0 0 0"')), "start-length", "error"),
    "clock": (
        described_as((r'causality="output"', 'causality="output" clocks="3"')),
        "clock",
        "error",
    ),
    "derivative": (described_as((r'derivative="3"', 'derivative="99"')), "derivative", "error"),
    "dependency": (
        described_as((r'dependencies="2 3"', 'dependencies="2 99"')),
        "dependency-dangling",
        "error",
    ),
    "output": (
        described_as((r'<Output valueReference="5"[^>]*/>', "")),
        "structure-outputs",
        "error",
    ),
    "continuous": (
        described_as(
            (
                r"</ModelVariables>",
                (
                    '<Int32 name="i" valueReference="9" causality="output" variability='
                    '"continuous" start="1" initial="exact"/></ModelVariables>'
                ),
            )
        ),
        "not-continuous",
        "error",
    ),
    "folder": (with_file("binaries/linux64/New.so", b"x"), "binary-folder", "warning"),
    "build": (with_file("sources/buildDescription.xml", b"<nothing/>"), "xml-schema", "error"),
    "terminals": (
        with_file("terminalsAndIcons/terminalsAndIcons.xml", b"<nothing/>"),
        "xml-schema",
        "error",
    ),
    "build-malformed": (with_file("sources/buildDescription.xml", b"<"), "xml-malformed", "error"),
    "build-source": (
        with_file(
            "sources/buildDescription.xml",
            b'<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="New">'
            b'<SourceFileSet><SourceFile name="gone.c"/></SourceFileSet></BuildConfiguration>'
            b"</fmiBuildDescription>",
        ),
        "sources-missing",
        "error",
    ),
}


@pytest.mark.parametrize("name", FMI3_DAMAGE)
def test_damage_of_an_fmi3_fmu_gives_its_finding(tmp_path: Path, name: str) -> None:
    """Cover what FMI 3 adds: arrays, clocks, one time, more files with schemas."""
    damage, code, level = FMI3_DAMAGE[name]
    files = described(FMI3, "documentation/index.html")
    damage(files)
    assert found(pack(files, tmp_path / "damaged.fmu")).get(code) == level


def test_fmi1_is_recognised_and_its_binary_has_its_own_names(tmp_path: Path) -> None:
    """FMI 1 puts the model's name before each function: a binary of FMI 3 has none of them."""
    files = described(FMI1, "documentation/_main.html")
    files["binaries/linux64/Old.so"] = (CONTAINER / "x86_64-linux/container_fmu.so").read_bytes()
    report = inspect_fmu(pack(files, tmp_path / "old.fmu"))
    assert report.model is not None
    assert (report.model.version, report.model.interfaces[0].kind) == ("1.0", "co-simulation")
    missing = [f.what for f in report.findings if f.code == "function-missing"]
    assert "Old_fmiDoStep is not exported" in missing


def test_a_name_twice_in_the_archive(fmus: Path, tmp_path: Path) -> None:
    """It is reported, because tools differ in the entry that they take."""
    path = tmp_path / "twice.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files_of(fmus / "WaveField.fmu").items():
            archive.writestr(name, content)
        with pytest.warns(UserWarning, match="Duplicate name"):
            archive.writestr(XML, b"<other/>")
    assert found(path)["entry-twice"] == "error"


def test_symbolic_link_and_bzip2_are_reported(fmus: Path, tmp_path: Path) -> None:
    """An FMU may have files only, stored or deflated."""
    path = tmp_path / "packed.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files_of(fmus / "WaveField.fmu").items():
            archive.writestr(name, content)
        link = zipfile.ZipInfo("resources/link")
        link.external_attr = 0o120777 << 16
        archive.writestr(link, "/etc/passwd")
        archive.writestr("resources/b", b"b" * 100, zipfile.ZIP_BZIP2)
    levels = found(path)
    assert (levels["entry-link"], levels["entry-method"]) == ("error", "error")


def test_entry_without_a_name(fmus: Path, tmp_path: Path) -> None:
    """A name that begins with NUL is empty for a ZIP reader."""
    content = pack(files_of(fmus / "WaveField.fmu"), tmp_path / "a.fmu").read_bytes()
    path = tmp_path / "nameless.fmu"
    path.write_bytes(content.replace(b"documentation/index", b"\0ocumentation/index"))
    assert found(path)["path-control"] == "error"


def test_encrypted_entry(fmus: Path, tmp_path: Path) -> None:
    """The flag alone is refused; no password is asked for."""
    content = bytearray(pack(files_of(fmus / "WaveField.fmu"), tmp_path / "a.fmu").read_bytes())
    place = content.index(b"PK\x01\x02")
    content[place + 8] |= 1
    path = tmp_path / "encrypted.fmu"
    path.write_bytes(content)
    assert found(path)["entry-encrypted"] == "error"


def test_changed_byte_in_an_entry(fmus: Path, tmp_path: Path) -> None:
    """The checksum shows which file is damaged."""
    path = pack(files_of(fmus / "WaveField.fmu"), tmp_path / "a.fmu")
    with zipfile.ZipFile(path) as archive:
        info = archive.getinfo("binaries/linux64/WaveField.so")
        place = info.header_offset + 30 + len(info.filename) + 5000
    content = bytearray(path.read_bytes())
    content[place] ^= 0xFF
    path.write_bytes(content)
    hurt = [f.where for f in inspect_fmu(path).findings if f.code == "entry-damaged"]
    assert hurt == ["binaries/linux64/WaveField.so"]


def test_bomb_is_not_unpacked(fmus: Path, tmp_path: Path) -> None:
    """A file of zeros a thousand times its packed size, and one that only claims to be huge."""
    files = files_of(fmus / "WaveField.fmu")
    path = tmp_path / "bomb.fmu"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
        archive.writestr("resources/zeros", bytes(80 << 20))
    assert found(path)["archive-bomb"] == "error"

    liar = pack(files, tmp_path / "liar.fmu")
    content = bytearray(liar.read_bytes())
    place = content.index(b"PK\x01\x02")
    content[place + 24 : place + 28] = struct.pack("<I", 0xFFFFFFF0)
    liar.write_bytes(content)
    assert not inspect_fmu(liar).valid


def test_xml_of_entities_does_not_grow(fmus: Path, tmp_path: Path) -> None:
    """A billion laughs, and an entity that reads a file of this machine."""
    files = files_of(fmus / "WaveField.fmu")
    laughs = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
    for head, body in (
        (f'<!DOCTYPE x [<!ENTITY l0 "ha">{laughs}]>', "&l11;"),
        ('<!DOCTYPE x [<!ENTITY f SYSTEM "file:///etc/passwd">]>', "&f;"),
    ):
        files[XML] = f"{head}<fmiModelDescription>{body}</fmiModelDescription>".encode()
        levels = found(pack(files, tmp_path / "entities.fmu"))
        assert {"xml-doctype", "xml-malformed"} & set(levels)


@pytest.mark.parametrize(
    "content",
    [b"", b"no archive", b"PK\x03\x04 cut short", b"PK\x05\x06" + bytes(18), bytes(1000)],
)
def test_file_that_is_not_an_fmu_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    """Empty, text, cut, a ZIP without entries: all give an error that names the file."""
    path = tmp_path / "nothing.fmu"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"nothing\.fmu: not an FMU"):
        inspect_fmu(path)


def test_an_fmu_packed_with_its_folder_is_reported(fmus: Path, tmp_path: Path) -> None:
    """The usual mistake: the folder was packed, not its content."""
    files = {f"WaveField/{n}": c for n, c in files_of(fmus / "WaveField.fmu").items()}
    with pytest.raises(InputError, match="packed from the wrong folder"):
        inspect_fmu(pack(files, tmp_path / "folder.fmu"))
    with pytest.raises(InputError, match="no such FMU"):
        inspect_fmu(tmp_path)


def test_many_findings_of_one_code_are_counted_not_listed(tmp_path: Path) -> None:
    """Ten thousand variables with the same fault give 25 lines and a count."""
    many = "".join(
        f'<Float64 name="v{i}" valueReference="{i + 100}" min="2" max="1"/>' for i in range(10_000)
    )
    files = described(FMI3, "documentation/index.html")
    described_as((r"</ModelVariables>", many + "</ModelVariables>"))(files)
    ranges = [
        f for f in inspect_fmu(pack(files, tmp_path / "m.fmu")).findings if f.code == "range-empty"
    ]
    assert len(ranges) == 26
    assert ranges[-1].what == "and 9975 more of this kind"


@pytest.mark.parametrize("bounds", ['min="1"', 'max="1"', 'min="1" max="1"'])
def test_bounds_belong_to_their_range(tmp_path: Path, bounds: str) -> None:
    """A start at a bound is within it, and a range of one value is not empty."""
    files = described(FMI3, "documentation/index.html")
    described_as((r'(<Float64 name="y" [^>]*)start="1"', rf'\1start="1" {bounds}'))(files)
    codes = {f.code for f in inspect_fmu(pack(files, tmp_path / "m.fmu")).findings}
    assert not codes & {"range-empty", "start-range"}


def test_names_cannot_write_to_the_terminal(fmus: Path, tmp_path: Path) -> None:
    """An escape sequence in a file name or in the XML comes out as text."""
    files = files_of(fmus / "WaveField.fmu")
    files["resources/\x1b[2Jred"] = b""
    report = inspect_fmu(pack(files, tmp_path / "escape.fmu"))
    assert report.findings
    assert not any("\x1b" in f.where + f.what for f in report.findings)


def test_every_rule_says_why() -> None:
    """No code without a reason and a level."""
    assert len(RULES) > 70
    for code, rule in RULES.items():
        assert rule.level in ("error", "warning", "note"), code
        assert len(rule.why) > 20, code


def test_at_least_thirty_codes_are_provoked() -> None:
    """The tests above provoke at least thirty different codes."""
    codes = {code for _, code, _ in (*FMI2_DAMAGE.values(), *FMI3_DAMAGE.values())}
    assert len(codes) >= 45
    assert codes <= set(RULES)
