"""Read the certificate in a JSON file, an FMU or a trace, and compare its gain with theirs.

A certificate proves its own K. An FMU must start with that K (`cosim.fmu.inspect`); a trace
must name the SHA-256 of the certificate whose gain was used.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError, unreadable
from cosim.fmu.inspect import certificate_in_fmu
from cosim.hinf.certificate import certificate_from_bytes, certificate_hash, read_certificate
from cosim.trace import Trace
from cosim.trace.rows import CERTIFICATE_ATTACHMENT, CERTIFICATE_HASH, DESIGN_ATTACHMENT

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
        raise unreadable(path, error, what="cannot be read") from error
    if first.startswith(_ZIP):
        return _in_fmu(path)
    if first == _MCAP:
        return _in_trace(path)
    if path.suffix == ".toml":
        raise InputError(
            "a TOML file has no certificate",
            where=str(path),
            expected="a design (.json), an FMU or a trace",
            hint=f"cosim design {path} --save {path.with_suffix('.json').name} makes a design of "
            "a system",
        )
    return EmbeddedCertificate(read_certificate(path), "file", None)


def _in_fmu(path: Path) -> EmbeddedCertificate:
    found = certificate_in_fmu(path)
    return EmbeddedCertificate(found.data, "FMU", found.mismatch)


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
