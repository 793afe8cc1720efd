"""Read the ZIP file of an FMU within limits: nothing in it is trusted."""

from __future__ import annotations

import re
import stat
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

from cosim.core import InputError
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
BROKEN = (
    *(zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, NotImplementedError),
    *(RuntimeError, ValueError, KeyError, IndexError, OverflowError),
)


class Archive:
    """The open archive of an FMU, from `open_archive`.

    Attributes
    ----------
    path : the file.
    entries : path inside -> entry, files only, the first of each name.
    findings : what is wrong with the ZIP itself.
    """

    def __init__(self, path: Path, zipped: zipfile.ZipFile) -> None:
        self.path = path
        self._zip = zipped
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
            other = folded.setdefault(name.casefold(), name)
            if other != name:
                self.findings.append(finding("entry-case", name, f"differs from {other} by case"))
        self.entries = MappingProxyType(entries)
        self.unpacked_bytes = sum(info.file_size for info in every)
        if self.unpacked_bytes > MOST_BYTES or len(every) > MAX_ENTRIES:
            size = f"{len(every)} entries of {self.unpacked_bytes} bytes in all"
            limit = f"at most {MAX_ENTRIES} of {MOST_BYTES}"
            self.findings.append(finding("archive-bomb", path.name, f"{size}; {limit}"))
        # many small entries can be a bomb together
        self.findings += _bomb(path.name, sum(i.compress_size for i in every), self.unpacked_bytes)

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
        except BROKEN:
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
            except BROKEN as error:
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
        except BROKEN as error:
            raise InputError(
                "the FMU cannot be unpacked", where=str(self.path), got=printable(str(error))
            ) from error


@contextmanager
def open_archive(path: Path) -> Iterator[Archive]:
    """Open the archive of an FMU as a context, and close it.

    Raises
    ------
    InputError : no such file, not a ZIP file, or one without modelDescription.xml.
    """
    where = str(path)
    if not path.is_file():
        raise InputError("no such FMU", where=where)
    try:
        zipped = zipfile.ZipFile(path)
    except BROKEN as error:
        raise InputError(
            "not an FMU",
            where=where,
            expected="a ZIP archive with modelDescription.xml",
            got=printable(str(error)) or type(error).__name__,
        ) from error
    with zipped:
        archive = Archive(path, zipped)
        if "modelDescription.xml" not in archive.entries:
            raise InputError(
                "not an FMU",
                where=where,
                expected="modelDescription.xml at the top of the archive",
                got=_instead(archive.entries),
            )
        yield archive


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
        yield finding("path-escapes", name, "the path leaves the folder of the FMU")
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
