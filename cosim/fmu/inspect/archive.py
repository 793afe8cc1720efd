"""Read the ZIP file of an FMU within limits: nothing in it is trusted."""

from __future__ import annotations

import hashlib
import io
import re
import stat
import struct
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from cosim.core import InputError, similar_files
from cosim.fmu.inspect.findings import Finding, finding, printable, refusal

MOST_BYTES = 4 << 30  # unpacked in all; the largest FMUs of practice have about 1 GiB
MAX_ENTRIES = 100_000
_BOMB_BYTES = 64 << 20  # below this size no ratio harms
_BOMB_RATIO = 250  # deflate reaches 1032; text of numbers about 10
_BOMB = f"at most {_BOMB_RATIO} times as many, where it is more than {_BOMB_BYTES}"
_CHUNK = 1 << 20
_ALLOWED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_LEADING = re.compile(r"^(?:[A-Za-z]:|[/\\])")
# what zipfile raises for damaged files
BROKEN_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, NotImplementedError),
    *(RuntimeError, ValueError, KeyError, IndexError, OverflowError),
)
"""What `zipfile` raises of archives that are damaged."""


class CheckedArchive:
    """An archive, checked without unpacking it; of an FMU from `open_archive`.

    Attributes
    ----------
    path : the file.
    entries : path inside -> entry, files only, the first of each name.
    findings : what is wrong with the ZIP itself.
    size : of the file [bytes].
    sha256 : of the bytes that were checked, which all else is read from.
    """

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        self.size = len(content)
        self._content = content
        zipped = self._zip = zipfile.ZipFile(io.BytesIO(content))
        self.findings: list[Finding] = []
        entries: dict[str, zipfile.ZipInfo] = {}
        folded: dict[str, str] = {}
        every = zipped.infolist()
        for info in every:
            name = info.orig_filename
            self.findings += _path_findings(name)
            self.findings += _entry_findings(info)
            if name.endswith("/"):
                continue
            if name in entries:
                self.findings.append(finding("entry-twice", name, "the entry is there twice"))
                continue
            entries[name] = info
            # macOS also takes composed and decomposed letters for the same
            same = unicodedata.normalize("NFC", name.casefold())
            other = folded.setdefault(same, name)
            if other != name:
                self.findings.append(finding("entry-case", name, f"differs from {other} by case"))
        self.entries = MappingProxyType(entries)
        self.unpacked_bytes = sum(info.file_size for info in every)
        if self.unpacked_bytes > MOST_BYTES or len(every) > MAX_ENTRIES:
            size = f"{len(every)} entries of {self.unpacked_bytes} bytes in all"
            limit = f"at most {MAX_ENTRIES} of {MOST_BYTES}"
            self.findings.append(finding("archive-bomb", path.name, f"{size}; {limit}"))
        # many small entries can be a bomb together, and several can lie on the same bytes
        self.findings += _bomb(path.name, self.size, self.unpacked_bytes)

    @cached_property
    def sha256(self) -> str:  # noqa: D102 - see the class
        return hashlib.sha256(self._content).hexdigest()

    @property
    def may_be_unpacked(self) -> bool:
        """Whether it is safe to unpack: no finding is an error."""
        return not any(each.level == "error" for each in self.findings)

    def read(self, name: str, most: int = MOST_BYTES) -> bytes | None:
        """Return the content of an entry; None if damaged, encrypted or over `most` bytes."""
        info = self.entries[name]
        if info.file_size > most:
            return None
        try:
            with self._zip.open(info) as stream:
                content = stream.read(most + 1)
        except BROKEN_ARCHIVE:
            return None
        return content if len(content) <= most else None

    def read_all(self) -> None:
        """Read every entry once and report those that do not unpack to what was packed."""
        if not self.may_be_unpacked:
            return
        for name, info in self.entries.items():
            try:
                with self._zip.open(info) as stream:
                    read = 0
                    while chunk := stream.read(_CHUNK):
                        read += len(chunk)
                if read != info.file_size:
                    raise EOFError(f"{read} bytes instead of {info.file_size}")
            except BROKEN_ARCHIVE as error:
                self.findings.append(finding("entry-damaged", name, str(error)))

    def require_sound(self) -> None:
        """Refuse an archive that is not safe to unpack.

        Raises
        ------
        InputError : not `may_be_unpacked`; names the entry and the limit that it exceeds.
        """
        for wrong in self.findings:
            if wrong.level == "error":
                raise refusal("this archive is not unpacked", self.path, wrong)

    def unpack(self, folder: Path) -> None:
        """Write every entry under `folder`.

        Raises
        ------
        InputError : not `may_be_unpacked`, or an entry is damaged.
        """
        self.require_sound()
        try:
            self._zip.extractall(folder)
        except BROKEN_ARCHIVE as error:
            raise InputError(
                "the FMU cannot be unpacked", where=str(self.path), got=printable(str(error))
            ) from error


def open_archive(path: Path, sha256: str | None = None) -> CheckedArchive:
    """Read the archive of an FMU, once: what is checked is what is unpacked.

    Parameters
    ----------
    sha256 : of the file as it was described; None if it was not.

    Raises
    ------
    InputError : no such file, not a ZIP file, one without modelDescription.xml, or one that has
        changed since it was described.
    """
    where = str(path)
    content = _content(path, described=sha256 is not None)
    if sha256 not in (None, hashlib.sha256(content).hexdigest()):
        raise InputError("the FMU has changed since it was read", where=where, hint="start again")
    try:
        archive = CheckedArchive(path, content)
    except BROKEN_ARCHIVE as error:
        raise InputError(
            "not an FMU",
            where=where,
            expected="a ZIP archive with modelDescription.xml",
            got=printable(str(error)) or type(error).__name__,
        ) from error
    if "modelDescription.xml" not in archive.entries:
        raise InputError(
            "not an FMU",
            where=where,
            expected="modelDescription.xml at the top of the archive",
            got=_instead(archive.entries),
        )
    return archive


def _content(path: Path, *, described: bool) -> bytes:
    if not (described or path.is_file()):
        raise InputError("no such FMU", where=str(path), hint=similar_files(path))
    try:
        return path.read_bytes()
    except OSError as error:
        what = "the FMU cannot be read any more" if described else "the FMU cannot be read"
        raise InputError(what, where=str(path), got=str(error)) from error


def _instead(names: MappingProxyType[str, zipfile.ZipInfo]) -> str:
    """Say what the archive has instead of modelDescription.xml."""
    near = [n for n in names if n.lower().replace("\\", "/").endswith("modeldescription.xml")]
    if near:
        return f"{printable(near[0])}: packed from the wrong folder, or spelled differently"
    return f"{len(names)} files, none of this name"


def _path_findings(name: str) -> Iterator[Finding]:
    parts = name.replace("\\", "/").split("/")
    if "\\" in name:
        yield finding("path-backslash", name, "the path has a backslash")
    if _LEADING.match(name) or ".." in parts:
        yield finding("path-escapes", name, "the path leaves the folder of the archive")
    if not name or any(ord(c) < 32 or ord(c) == 127 for c in name):
        yield finding("path-control", name, "the path is empty or has a control character")


def _entry_findings(info: zipfile.ZipInfo) -> Iterator[Finding]:
    name = info.orig_filename
    if info.flag_bits & 0x1:
        yield finding("entry-encrypted", name, "the entry is encrypted")
    if info.compress_type not in _ALLOWED:
        yield finding("entry-method", name, f"packed by ZIP method {info.compress_type}")
    if stat.S_ISLNK(info.external_attr >> 16):
        yield finding("entry-link", name, "the entry is a symbolic link")
    yield from _bomb(name, info.compress_size, info.file_size)


def _bomb(name: str, packed: int, unpacked_bytes: int) -> Iterator[Finding]:
    if unpacked_bytes > _BOMB_BYTES and unpacked_bytes > _BOMB_RATIO * max(packed, 1):
        yield finding("archive-bomb", name, f"{packed} bytes unpack to {unpacked_bytes}; {_BOMB}")
