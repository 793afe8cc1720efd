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
from collections.abc import Iterable, Iterator
from contextlib import suppress
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
_MOST_OF_NAME = 255  # bytes of one name, on every usual file system
_MOST_OF_PATH = 800  # bytes; macOS allows 1024, with the temporary folder before it
_FOLDERS = ("resources",)
"""Folders of every FMU and system: made where none is packed, so that no file can have the name."""
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
    entries : path inside -> entry, files only, the first of each place that is unpacked to.
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
        every = zipped.infolist()
        for info in every:
            self.findings += _path_findings(info.orig_filename)
            self.findings += _entry_findings(info)
        files: dict[str, zipfile.ZipInfo] = {}
        again: list[tuple[zipfile.ZipInfo, zipfile.ZipInfo]] = []
        for info in every:
            if not info.orig_filename.endswith("/"):
                first = files.setdefault(_place(info), info)
                again += [(first, info)] if first is not info else []
        folders = {_place(info) for info in every if info.orig_filename.endswith("/")} - {""}
        self._folders = sorted(folders)
        self.findings += _clashes(files, folders)
        entries = {info.orig_filename: info for info in files.values()}
        self.entries = MappingProxyType(entries)
        self.unpacked_bytes = sum(info.file_size for info in every)
        if self.unpacked_bytes > MOST_BYTES or len(every) > MAX_ENTRIES:
            size = f"{len(every)} entries of {self.unpacked_bytes} bytes in all"
            limit = f"at most {MAX_ENTRIES} of {MOST_BYTES}"
            self.findings.append(finding("archive-bomb", path.name, f"{size}; {limit}"))
        # many small entries can be a bomb together, and several can lie on the same bytes
        self.findings += _bomb(path.name, self.size, self.unpacked_bytes)
        self.findings += [self._doubled(*pair) for pair in again]

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
                for _ in self._pieces(info):
                    pass
            except BROKEN_ARCHIVE as error:
                self.findings.append(finding("entry-damaged", name, str(error)))

    def _pieces(self, info: zipfile.ZipInfo) -> Iterator[bytes]:
        """Yield the content of an entry, piece by piece; one of `BROKEN_ARCHIVE` if damaged."""
        with self._zip.open(info) as stream:
            read = 0
            while piece := stream.read(_CHUNK):
                read += len(piece)
                yield piece
        if read != info.file_size:
            raise EOFError(f"{read} bytes instead of {info.file_size}")

    def _doubled(self, first: zipfile.ZipInfo, second: zipfile.ZipInfo) -> Finding:
        """Judge two entries of one place: harmless where their bytes are alike."""
        alike = False
        if self.may_be_unpacked and first.file_size == second.file_size:
            with suppress(*BROKEN_ARCHIVE):
                pairs = zip(self._pieces(first), self._pieces(second), strict=True)
                alike = all(one == other for one, other in pairs)
        what = (
            "the entry is there twice, with the same bytes" if alike else "the entry is there twice"
        )
        return finding(
            "entry-twice", second.orig_filename, what, level="warning" if alike else "error"
        )

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
            for place in self._folders:
                (folder / place).mkdir(parents=True, exist_ok=True)
            for info in self.entries.values():
                target = folder / _place(info)
                target.parent.mkdir(parents=True, exist_ok=True)
                with target.open("xb") as file:
                    file.writelines(self._pieces(info))
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
            hint="the .fmu file as the tool exported it; copy or export it again",
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
        hint = similar_files(path) or "look at its path: it starts from this folder"
        raise InputError("no such FMU", where=str(path), hint=hint)
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
    if not _parts(name) or any(ord(c) < 32 or ord(c) == 127 for c in name):
        yield finding("path-control", name, "the path is empty or has a control character")
    longest = max((len(part.encode("utf-8", "replace")) for part in parts), default=0)
    size = len(name.encode("utf-8", "replace"))
    if longest > _MOST_OF_NAME or size > _MOST_OF_PATH:
        what = f"{size} bytes, {longest} between slashes; at most {_MOST_OF_PATH}, {_MOST_OF_NAME}"
        yield finding("path-long", name, what)


def _parts(name: str) -> list[str]:
    return [part for part in name.split("/") if part not in ("", ".")]


def _place(info: zipfile.ZipInfo) -> str:
    """Return where an entry is unpacked to: ./a//b is a/b."""
    return "/".join(_parts(info.orig_filename))


def _clashes(places: Iterable[str], folders: Iterable[str]) -> Iterator[Finding]:
    """Find files that take the place of another file or of a folder on some system."""
    inside = {_folded(folder) for folder in (*folders, *_FOLDERS)}
    for place in (*places, *folders):
        parts = _folded(place).split("/")
        inside.update("/".join(parts[:n]) for n in range(1, len(parts)))
    known: dict[str, str] = {}
    for place in places:
        other = known.setdefault(_folded(place), place)
        if other != place:
            yield finding("entry-case", place, f"differs from {other} by case")
        if _folded(place) in inside:
            yield finding("entry-folder", place, "a file where a folder of this name has to be")


def _folded(place: str) -> str:
    """Return what is alike for names that one file system or another takes for the same."""
    # macOS also takes composed and decomposed letters for the same
    return unicodedata.normalize("NFC", place.casefold())


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
