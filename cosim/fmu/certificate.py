"""The certificate inside a controller FMU, and whether it is about the gain there.

A certificate proves its own K; an FMU must start with that K by its model description.
"""

from __future__ import annotations

import re
import zipfile
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

from cosim.core import InputError
from cosim.fmu.export.spec import CERTIFICATE
from cosim.hinf import certificate_from_bytes

MOST_BYTES = 64 * 2**20
"""Largest certificate or model description that is read from an archive."""

_ENTRY = re.compile(r"K\[([1-9][0-9]{0,5}),([1-9][0-9]{0,5})\]")


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


def _another_gain(data: Any, description: bytes, path: Path) -> str | None:
    """Say how the start values K[i,j] differ from the certificate's K; None if they do not."""
    try:
        root = ET.fromstring(description)  # noqa: S314 - expat bounds what entities expand to
    except ET.ParseError as error:
        raise InputError(
            "the model description is not XML", where=str(path), got=str(error)
        ) from error
    starts: dict[tuple[int, int], str | None] = {}
    for element in root.iter():
        entry = _ENTRY.fullmatch(element.get("name", ""))
        if entry is not None:  # FMI 2 has the start in a child, FMI 3 in the element itself
            holders = [element, *element]
            found = next((h.get("start") for h in holders if h.get("start") is not None), None)
            starts[int(entry[1]), int(entry[2])] = found
    K = data.get("K") if isinstance(data, dict) else None
    rows = K if isinstance(K, list) and all(isinstance(row, list) for row in K) else []
    proved = {(i, j): v for i, row in enumerate(rows, 1) for j, v in enumerate(row, 1)}
    if set(starts) != set(proved):
        return f"the FMU has {len(starts)} parameters K[i,j], the certificate {len(proved)} entries"
    for (i, j), text in sorted(starts.items()):
        if not _same(text, proved[i, j]):
            return f"K[{i},{j}] of the FMU is {text}, that of the certificate {proved[i, j]!r}"
    return None


def _same(text: str | None, value: Any) -> bool:
    try:
        return text is not None and isinstance(value, int | float) and float(text) == value
    except ValueError:
        return False
