"""The certificate inside a controller FMU, and whether it is about the gain there.

A certificate proves its own K; an FMU must start with that K by its model description. One of an
output feedback is about the injections and the model of the observer as well.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

from cosim.core import InputError
from cosim.fmu.export.spec import CERTIFICATE
from cosim.hinf.certificate import certificate_from_bytes

MOST_BYTES = 64 * 2**20
"""Largest certificate or model description that is read from an archive."""

_ENTRY = re.compile(r"([^\[]+)\[[1-9][0-9]{0,5},[1-9][0-9]{0,5}\]")


class CertificateInFmu(NamedTuple):
    """A certificate as bytes and as JSON values; `mismatch`: why it is not about the FMU's gain."""

    content: bytes
    data: Any
    mismatch: str | None


def carries_certificate(path: Path) -> bool:
    """Whether an archive has an entry for a certificate; False also for what is no archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            return CERTIFICATE in archive.namelist()
    except (OSError, EOFError, RuntimeError, ValueError, zipfile.BadZipFile):
        return False


def certificate_in_fmu(path: Path) -> CertificateInFmu:
    """Read the certificate in an FMU, and compare its gain with the start values K[i,j].

    Raises
    ------
    InputError : not an FMU, or one without a certificate.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if CERTIFICATE not in names:
                raise InputError(
                    "this FMU carries no certificate",
                    where=str(path),
                    expected=f"{CERTIFICATE} in it, as in a controller of this project",
                    hint="cosim fmu controller packs a saved design with its certificate",
                )
            content = _bounded(archive, CERTIFICATE, path)
            description = _bounded(archive, "modelDescription.xml", path)
    except (OSError, EOFError, KeyError, RuntimeError, zipfile.BadZipFile) as error:
        raise InputError("not an FMU", where=str(path), got=str(error)) from error
    data = certificate_from_bytes(content, f"{path}: {CERTIFICATE}")
    return CertificateInFmu(content, data, _another_gain(data, description, path))


def _bounded(archive: zipfile.ZipFile, name: str, path: Path) -> bytes:
    """Read an entry of at most `MOST_BYTES`, whatever size it claims."""
    with archive.open(name) as stream:
        content = stream.read(MOST_BYTES + 1)
    if len(content) > MOST_BYTES:
        raise InputError(
            f"{name} is too large", where=str(path), expected=f"at most {MOST_BYTES} bytes"
        )
    return content


def certified_values(data: Any) -> dict[str, Any]:
    """Return by parameter of an FMU the value that a certificate is about.

    That is its gain, and of an output feedback the injections and the model of the observer.
    """
    if not isinstance(data, dict):
        return {}
    matrices = {"K": data.get("K")}
    late: list[Any] = []
    if data.get("kind") == "output-feedback":
        plant, measurements = data["plant"], data["measurements"]
        # a delay through which only the control acts is the link's
        late = [delay for delay in plant["delays"] if any(any(row) for row in delay["A"])]
        matrices |= {"A": plant["A"], "B": plant["B"]}
        matrices |= {f"A{k}": delay["A"] for k, delay in enumerate(late, 1)}
        for one, L in zip(measurements, data["L"], strict=True):
            matrices |= {f"C.{one['name']}": one["C"], f"L.{one['name']}": L}
    named = ["delay.d"] if len(late) == 1 else [f"delay.d{k}" for k in range(1, len(late) + 1)]
    found = {
        f"{letter}[{i},{j}]": value
        for letter, rows in matrices.items()
        if isinstance(rows, list) and all(isinstance(row, list) for row in rows)
        for i, row in enumerate(rows, 1)
        for j, value in enumerate(row, 1)
    }
    return found | {name: delay["d"] for name, delay in zip(named, late, strict=True)}


def _another_gain(data: Any, description: bytes, path: Path) -> str | None:
    """Say how the start values differ from the certificate's; None if they do not."""
    try:
        root = ET.fromstring(description)  # noqa: S314 - expat bounds what entities expand to
    except ET.ParseError as error:
        raise InputError(
            "the model description is not XML", where=str(path), got=str(error)
        ) from error
    try:
        proved = certified_values(data)
    except (KeyError, TypeError, ValueError):
        return "the certificate of an output feedback is not complete"
    starts: dict[str, str | None] = {}
    letters = {_letter(name) for name in proved} | {"K"}
    for element in root.iter():
        name = element.get("name", "")
        if _letter(name) in letters:  # FMI 2 has the start in a child, FMI 3 in the element itself
            holders = [element, *element]
            found = next((h.get("start") for h in holders if h.get("start") is not None), None)
            starts[name] = found
    if "L" in {letter.split(".")[0] for letter in letters} and not _entries_of("K", starts):
        proved = {name: value for name, value in proved.items() if _letter(name) != "K"}
    for letter in sorted(letters):
        own, expected = _entries_of(letter, starts), _entries_of(letter, proved)
        if own != expected:
            return (
                f"the FMU has {len(own)} parameters {letter}[i,j], "
                f"the certificate {len(expected)} entries"
            )
    for name, value in proved.items():
        if not _same(starts[name], value):
            return f"{name} of the FMU is {starts[name]}, that of the certificate {value!r}"
    return None


def _letter(name: str) -> str:
    """Return the matrix of an entry; of any other name, itself."""
    found = _ENTRY.fullmatch(name)
    return name if found is None else found[1]


def _entries_of(letter: str, values: Mapping[str, Any]) -> set[str]:
    return {name for name in values if _letter(name) == letter}


def _same(text: str | None, value: Any) -> bool:
    try:
        return text is not None and isinstance(value, int | float) and float(text) == value
    except ValueError:
        return False
