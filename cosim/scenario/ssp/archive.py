"""Read an SSP archive; none of its entries is trusted."""

from __future__ import annotations

import io
import math
import posixpath
import tomllib
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any, Self
from urllib.parse import unquote, urlsplit

from lxml import etree

from cosim.core import InputError, unreadable
from cosim.fmu.inspect import BROKEN_ARCHIVE, MAX_XML, CheckedArchive
from cosim.scenario.ssp.names import SSD, tag
from cosim.scenario.ssp.write_ssd import check_schema

MAX_FMU = 2**29
MAX_IN_ALL = 2**31
MAX_ENTRIES = 10_000
"""Larger archives are attacks, or need another tool."""

_ROOTS = (
    tag("ssd", "SystemStructureDescription"),
    tag("ssv", "ParameterSet"),
    tag("ssm", "ParameterMapping"),
)
_PIECE = 2**20
BROKEN = (EOFError, zipfile.BadZipFile, RuntimeError, NotImplementedError, zlib.error)


class Archive:
    """An archive that is open for reading; use as a context manager.

    Attributes
    ----------
    notes : sentences about deviations from the standard, and what was left out.

    Raises
    ------
    InputError : not an archive, or one that is not safe to unpack, as an FMU is checked.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._read = 0

    def __enter__(self) -> Self:
        try:
            content = self.path.read_bytes()
            checked = CheckedArchive(self.path, content)
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except BROKEN_ARCHIVE as error:
            if isinstance(error, OSError):
                raise unreadable(self.path, error, what="the archive cannot be read") from error
            hint = "a .ssp file as cosim ssp export, or another tool, writes it"
            raise self.wrong(
                "not an SSP archive", expected="a zip file", got=str(error), hint=hint
            ) from error
        checked.require_sound()
        names = self._zip.namelist()
        if len(names) > MAX_ENTRIES:
            raise self.wrong(
                "not an SSP archive that can be read",
                expected=f"at most {MAX_ENTRIES} entries",
                got=f"{len(names)} entries",
            )
        self._names = set(names)
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def wrong(self, what: str, inside: str | None = None, **more: str | None) -> InputError:
        """Make an error about this archive; `inside`: the entry, with a line if known."""
        where = str(self.path) if inside is None else f"{self.path}: {inside}"
        return InputError(what, where=where, **more)

    def names(self) -> list[str]:
        """Return the names of the entries, sorted."""
        return sorted(self._names)

    def entry(self, source: str, base: str, where: str) -> str:
        """Resolve a URI, relative to the entry `base`, to the name of an entry.

        Raises
        ------
        InputError : it leads out of the archive, or there is no such entry.
        """
        parts = urlsplit(source)
        path = unquote(parts.path)
        joined = posixpath.normpath(posixpath.join(posixpath.dirname(base), path))
        outside = joined.startswith("..") or path.startswith("/") or "\\" in path or "\0" in path
        if parts.scheme or parts.netloc or parts.fragment or parts.query or outside or not path:
            raise self.wrong(
                "a source outside the archive, or of an unsupported kind",
                where,
                expected="a path in the archive, as in resources/plant.fmu",
                got=source,
            )
        if joined not in self._names:
            raise self.wrong("there is no such entry", where, got=joined)
        return joined

    def read(self, name: str, most: int = MAX_XML) -> bytes:
        """Read an entry of at most `most` bytes, whatever size it claims.

        Raises
        ------
        InputError : missing, too large, damaged, or encrypted.
        """
        if name not in self._names:
            hint = "is this an FMU, or a trace?" if name == SSD else None
            raise self.wrong(f"there is no {name}", hint=hint)
        content = io.BytesIO()
        self._copy(name, content, most)
        return content.getvalue()

    def extract(self, name: str, to: Path) -> None:
        """Write an FMU of the archive to a file.

        Raises
        ------
        InputError : too large, damaged, encrypted, or a file that cannot be written.
        """
        try:
            with to.open("wb") as stream:
                self._copy(name, stream, MAX_FMU)
        except OSError as error:
            raise InputError("the FMU cannot be written", where=str(to), got=str(error)) from error

    def _copy(self, name: str, to: IO[bytes], most: int) -> None:
        copied = 0
        try:
            with self._zip.open(name) as stream:
                while copied <= most and (piece := stream.read(_PIECE)):
                    copied += len(piece)
                    to.write(piece)
        except BROKEN as error:
            raise self.wrong("an entry cannot be read", name, got=str(error)) from error
        self._read += copied
        if copied > most or self._read > MAX_IN_ALL:
            raise self.wrong(
                "an entry is too large",
                name,
                expected=f"at most {most} bytes, {MAX_IN_ALL} of all that is read",
            )

    def xml(self, name: str, kind: str) -> Any:
        """Parse an XML entry; deviations from the schema `kind`.xsd go to `notes`.

        Some tools write archives that break the schema and still have a clear meaning.

        Raises
        ------
        InputError : not XML, with a document type, or not a file of SSP.
        """
        content = self.read(name)
        parser = etree.XMLParser(
            resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
        )
        try:
            root = etree.fromstring(content, parser)
        except etree.XMLSyntaxError as error:
            raise self.wrong("not XML", name, got=str(error)) from error
        if root.getroottree().docinfo.doctype:
            what = "a file of SSP has no document type"
            raise self.wrong(what, name, expected="none: no <!DOCTYPE")
        try:
            check_schema(content, kind, where=name)
        except InputError as error:
            if root.tag not in _ROOTS:
                raise self.wrong(
                    "not a file of SSP", name, expected=f"{kind}.xsd", got=error.got
                ) from error
            self.notes.append(f"{error.where}: {error.what}: {error.got}")
        return root

    def needed(self, element: Any, attribute: str, entry: str) -> str:
        """Return a required attribute; an InputError if it is missing."""
        found = element.get(attribute)
        if found is None:
            raise self.wrong(
                f"there is no {attribute}",
                f"{entry}:{element.sourceline}",
                got=etree.QName(element).localname,
            )
        return str(found)

    def toml(self, name: str, text: str) -> dict[str, Any]:
        """Parse the content of an annotation of this project."""
        try:
            return tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            what = f"the annotation of {name!r} is not TOML"
            raise self.wrong(what, SSD, got=str(error)) from error

    def number(self, element: Any, attribute: str, entry: str, default: float) -> float:
        """Return a numeric attribute, or `default` if it is missing; see `as_number`."""
        text = element.get(attribute)
        return default if text is None else self.as_number(text, f"{entry}:{element.sourceline}")

    def as_number(self, text: str, where: str) -> float:
        """Convert a text to a finite number; an InputError if it is none."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong("not a finite number", where, got=text)
        return value
