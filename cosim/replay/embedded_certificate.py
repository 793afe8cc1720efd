"""Read the certificate in a JSON file, an FMU or a trace, and compare its gain with theirs.

A certificate proves its own K. An FMU must start with that K by its model description; a trace
must name the SHA-256 of the certificate whose gain was used.
"""

from __future__ import annotations

import hashlib
import re
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from cosim.core import InputError
from cosim.fmu import CERTIFICATE
from cosim.hinf import certificate_from_bytes, certificate_hash, read_certificate
from cosim.trace import CERTIFICATE_ATTACHMENT, CERTIFICATE_HASH, DESIGN_ATTACHMENT, Trace

MOST_BYTES = 64 * 2**20
"""Largest certificate or model description that is read from an archive."""

_ENTRY = re.compile(r"K\[([1-9][0-9]{0,5}),([1-9][0-9]{0,5})\]")
_ZIP, _MCAP = b"PK\x03\x04", b"\x89MCAP"


@dataclass(frozen=True)
class EmbeddedCertificate:
    """A certificate and where it was found.

    Attributes
    ----------
    data : for `check_certificate`.
    container : "file", "FMU" or "trace".
    mismatch : why it is not about the gain of its container; None if it is.
    """

    data: Any
    container: str
    mismatch: str | None

    @property
    def sha256(self) -> str | None:
        """Hash of the certificate without notes; None if it cannot be a certificate."""
        try:
            return certificate_hash(self.data)
        except (AttributeError, TypeError, ValueError, RecursionError):
            return None


def certificate_in(path: Path) -> EmbeddedCertificate:
    """Read the certificate in a JSON file, an FMU or a trace; the first bytes tell which.

    Raises
    ------
    InputError : the file cannot be read, is none of the three, or has no certificate.
    LossError : a trace that is cut short or damaged.
    """
    try:
        with path.open("rb") as stream:
            first = stream.read(len(_MCAP))
    except OSError as error:
        raise InputError("cannot be read", where=str(path), got=error.strerror) from error
    if first.startswith(_ZIP):
        return _in_fmu(path)
    if first == _MCAP:
        return _in_trace(path)
    return EmbeddedCertificate(read_certificate(path), "file", None)


def _in_fmu(path: Path) -> EmbeddedCertificate:
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
    return EmbeddedCertificate(data, "FMU", _another_gain(data, description, path))


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


def _in_trace(path: Path) -> EmbeddedCertificate:
    trace = Trace(path)
    # a trace of an earlier version has the certificate inside the design
    attached = CERTIFICATE_ATTACHMENT in trace.attachments
    name = CERTIFICATE_ATTACHMENT if attached else DESIGN_ATTACHMENT
    content = trace.attachments.get(name)
    if content is None:
        raise InputError(
            "this trace carries no certificate",
            where=str(path),
            expected=f"an attachment {CERTIFICATE_ATTACHMENT}, as a run with a design has it",
            got=", ".join(trace.attachments) or "no attachments",
        )
    data = certificate_from_bytes(bytes(content), f"{path}: {name}")
    key = CERTIFICATE_HASH if attached else "design.sha256"
    recorded, found = trace.run.get(key), hashlib.sha256(content).hexdigest()
    differs = f"{name} is not the one of the run: its SHA-256 is {found}, the run's {recorded}"
    return EmbeddedCertificate(data, "trace", None if recorded == found else differs)
