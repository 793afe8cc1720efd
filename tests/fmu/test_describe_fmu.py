"""Descriptions of FMUs: what is read from a file, and what is refused before loading."""

from __future__ import annotations

import hashlib
import re
import zipfile
from typing import TYPE_CHECKING

import pytest

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.fmu.export import CATALOGUE
from cosim.fmu.inspect import inspect_fmu

if TYPE_CHECKING:
    from pathlib import Path


def altered(source: Path, target: Path, *changes: tuple[str, str]) -> Path:
    """A copy of an FMU whose model description is changed; each pattern must be found."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                text = content.decode()
                for pattern, replacement in changes:
                    assert re.search(pattern, text), pattern
                    text = re.sub(pattern, replacement, text)
                content = text.encode()
            new.writestr(name, content)
    return target


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_ports_are_the_table_of_the_component(fmus: Path, name: str) -> None:
    """Every variable with its reference, causality, unit, start and feedthrough."""
    path = fmus / f"{name}.fmu"
    found = describe_fmu(path)
    assert list(found.ports) == [v.name for v in CATALOGUE[name].variables]
    for reference, variable in enumerate(CATALOGUE[name].variables, 1):
        port = found.ports[variable.name]
        assert (port.reference, port.causality) == (reference, variable.causality)
        assert (port.unit, port.start) == (variable.unit, variable.start)
        assert port.variability == variable.variability
        assert port.kind == {"Real": "float", "Integer": "int"}[variable.kind]
        assert port.feedthrough == bool(variable.depends_on)
    assert found.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert found.variable_step
    with zipfile.ZipFile(path) as archive:
        assert found.xml == archive.read("modelDescription.xml")


def test_undeclared_dependencies_mean_feedthrough(fmus: Path, tmp_path: Path) -> None:
    """As FMI defines, an output without declared dependencies depends on all inputs."""
    silent = altered(
        fmus / "AuvPlant.fmu",
        tmp_path / "AuvPlant.fmu",
        (r' dependencies="" dependenciesKind=""', ""),
    )
    assert describe_fmu(silent).ports["eta.x"].feedthrough
    sea = altered(
        fmus / "WaveField.fmu",
        tmp_path / "WaveField.fmu",
        (r' dependencies="" dependenciesKind=""', ""),
    )
    assert not describe_fmu(sea).ports["disturbance.u"].feedthrough  # it has no inputs


def test_unknown_variable_suggests_the_nearest(fmus: Path) -> None:
    """The error names the component and what may have been meant."""
    with pytest.raises(InputError) as caught:
        describe_fmu(fmus / "AuvPlant.fmu").port("eta.phi", where="component 'auv'")
    assert "component 'auv': there is no variable 'eta.phi'" in str(caught.value)
    assert "eta.psi" in str(caught.value)


def test_error_of_a_missing_file_says_where_paths_start(tmp_path: Path) -> None:
    """A folder in place of the file is named as such."""
    for path, hint in ((tmp_path / "None.fmu", "folder of its file"), (tmp_path, "is a folder")):
        with pytest.raises(InputError, match=hint):
            describe_fmu(path)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 cut short"])
def test_file_that_is_not_an_archive_is_refused(tmp_path: Path, content: bytes) -> None:
    """Empty, text, a cut archive: all give an error with the path."""
    path = tmp_path / "Broken.fmu"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"Broken\.fmu: not a valid FMU"):
        describe_fmu(path)


def test_archive_without_a_description_is_refused(tmp_path: Path) -> None:
    """A ZIP alone is no FMU."""
    path = tmp_path / "Empty.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "nothing here")
    with pytest.raises(InputError, match="not a valid FMU"):
        describe_fmu(path)


@pytest.mark.parametrize(
    ("pattern", "replacement", "message"),
    [
        (r"<ModelVariables>", "<ModelVariables", "not a valid FMU"),
        (r'name="eta.y"', 'name="eta.x"', "not a valid FMU"),
        (r'causality="input"', 'causality="inlet"', "not a valid FMU"),
        (r'fmiVersion="2.0"', 'fmiVersion="9.0"', "Broken.fmu"),
    ],
)
def test_description_that_breaks_the_standard_is_refused(
    fmus: Path, tmp_path: Path, pattern: str, replacement: str, message: str
) -> None:
    """Malformed XML, a name twice, a causality that does not exist, another version."""
    path = altered(fmus / "AuvPlant.fmu", tmp_path / "Broken.fmu", (pattern, replacement))
    with pytest.raises(InputError, match=re.escape(message)):
        describe_fmu(path)


def test_model_exchange_alone_cannot_be_run(fmus: Path, tmp_path: Path) -> None:
    """Such an FMU is valid but refused, with a message that names its kind."""
    path = altered(
        fmus / "WaveField.fmu",
        tmp_path / "Exchange.fmu",
        (r"<CoSimulation[^>]*/>", '<ModelExchange modelIdentifier="WaveField" />'),
    )
    with pytest.raises(InputError) as caught:
        describe_fmu(path)
    assert "this FMU cannot be run" in str(caught.value)
    assert caught.value.got == "FMI 2.0, model exchange only"


def test_a_description_in_another_encoding_is_read(native_fmus: Path, tmp_path: Path) -> None:
    """The check calls it an error; what it says is read all the same."""
    source = native_fmus / "WaveField.fmu"
    change = ("<\\?xml[^>]*>", '<?xml version="1.0" encoding="ISO-8859-1"?>')
    path = altered(source, tmp_path / "latin.fmu", change)
    assert [*describe_fmu(path).ports] == [*describe_fmu(source).ports]
    assert "xml-encoding" in [each.code for each in inspect_fmu(path).findings]
