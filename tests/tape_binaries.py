"""Binaries that read their model, compiled once per session for this machine."""

from __future__ import annotations

from shared import made_once

from cosim.fmu.export.native.platforms import host
from cosim.fmu.export.native.tape_package import tape_binary


def binary_of(kind: str, version: str = "2.0") -> bytes:
    """The binary of a kind of behaviour and a version of FMI."""

    def compiled(folder: object) -> None:
        content = tape_binary(kind, version, host(), cross=False)
        (folder / "binary").write_bytes(content)  # type: ignore[operator]

    return (made_once(f"tape/{version}/{kind}", compiled) / "binary").read_bytes()
