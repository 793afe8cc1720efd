"""Randomly damaged FMUs give findings or an input error, in bounded time."""

from __future__ import annotations

import zipfile
from pathlib import Path

import fmpy
import pytest
from fmu.packed import FMI1, FMI3, XML, described, files_of, pack
from hypothesis import HealthCheck, given, settings, strategies as st

from cosim.core import InputError
from cosim.fmu.inspect import fmu_facts, inspect_fmu

CONTAINER = Path(fmpy.__file__).parent / "container_fmu" / "binaries"
FLIPS = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), max_size=12)
SLOW = settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])


def flipped(content: bytes, flips: list[tuple[float, int]], head: int | None = None) -> bytes:
    """The bytes with some changed, of the first `head` bytes only if given."""
    data = bytearray(content)
    size = min(len(data), head or len(data))
    for place, mask in flips:
        if size:
            data[int(place * size)] ^= mask
    return bytes(data)


def answered(path: Path) -> None:
    """A report with reasons and plain facts, or an input error."""
    try:
        report = inspect_fmu(path)
    except InputError:
        return
    assert report.valid == (not any(f.level == "error" for f in report.findings))
    assert fmu_facts(report)["bytes"] == path.stat().st_size


@SLOW
@given(flips=FLIPS, cut=st.floats(0, 1))
def test_archive_cut_and_flipped(
    fmus: Path, tmp_path: Path, flips: list[tuple[float, int]], cut: float
) -> None:
    """Any bytes of the file."""
    content = (fmus / "WaveField.fmu").read_bytes()
    path = tmp_path / "fuzzed.fmu"
    path.write_bytes(flipped(content, flips)[: max(1, int(len(content) * (cut or 1)))])
    answered(path)


@SLOW
@given(flips=FLIPS)
def test_directory_of_the_archive_flipped(
    fmus: Path, tmp_path: Path, flips: list[tuple[float, int]]
) -> None:
    """Names, sizes, offsets, methods: the part that a ZIP reader believes."""
    path = tmp_path / "fuzzed.fmu"
    source = fmus / "WaveField.fmu"
    content = source.read_bytes()
    with zipfile.ZipFile(source) as archive:
        start = archive.start_dir
    path.write_bytes(content[:start] + flipped(content[start:], flips))
    answered(path)


@SLOW
@given(flips=FLIPS, cut=st.floats(0.2, 1), which=st.sampled_from(["1", "2", "3"]))
def test_description_flipped(
    fmus: Path, tmp_path: Path, flips: list[tuple[float, int]], cut: float, which: str
) -> None:
    """The XML of each version of FMI."""
    if which == "2":
        files = {XML: files_of(fmus / "WaveField.fmu")[XML]}
    else:
        files = described({"1": FMI1, "3": FMI3}[which], "documentation/index.html")
    xml = flipped(files[XML], flips)
    files[XML] = xml[: int(len(xml) * cut)] if cut < 0.9 else xml
    answered(pack(files, tmp_path / "fuzzed.fmu"))


@settings(max_examples=100)
@given(data=st.data())
def test_numbers_of_the_description_replaced(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    """Well-formed XML whose attribute values are arbitrary text."""
    parts = FMI3.split('"')
    place = data.draw(st.integers(8, len(parts) // 2 - 1)) * 2 + 1
    parts[place] = data.draw(
        st.one_of(
            st.integers().map(str),
            st.floats().map(str),
            st.text("0123456789 -.aé[]'", max_size=20),
        )
    )
    folder = tmp_path_factory.mktemp("numbers")
    answered(pack({XML: '"'.join(parts).encode()}, folder / "fuzzed.fmu"))


@pytest.mark.slow
@SLOW
@given(
    name=st.sampled_from(
        [
            "x86_64-linux/container_fmu.so",
            "x86_64-windows/container_fmu.dll",
            "aarch64-darwin/container_fmu.dylib",
        ]
    ),
    flips=FLIPS,
    cut=st.floats(0, 1),
)
def test_headers_of_libraries_flipped(
    tmp_path: Path, name: str, flips: list[tuple[float, int]], cut: float
) -> None:
    """The first kilobytes decide what a loader reads: an image, or a reason why there is none."""
    content = flipped((CONTAINER / name).read_bytes(), flips, head=4096)
    cut_off = content[: int(len(content) * cut)] if cut < 0.5 else content
    files = described(FMI3, "documentation/index.html") | {f"binaries/{name}": cut_off}
    (found,) = inspect_fmu(pack(files, tmp_path / "fuzzed.fmu")).binaries
    reasons = [found.damage is not None, found.unread is not None]
    assert [bool(found.images), *reasons].count(True) == 1
