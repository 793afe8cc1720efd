"""What stands beside or in the place of a trace: runs that have died, links, devices, others."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from pathlib import Path

import pytest

from cosim.core import InputError, LossError
from cosim.trace import Signal, Trace, TraceWriter, recover, verify


def write(path: Path, values: list[float], *, finish: bool = True) -> None:
    """A trace of some rows; or the file of a run that did not end."""
    with TraceWriter(path, run={}) as writer:
        topic = writer.add_topic("/x", [Signal("x")], schema_name="t.X")
        for k, value in enumerate(values):
            writer.write(topic, k, [value])
        if finish:
            writer.finish({})


def values(path: Path) -> list[float]:
    found: list[float] = Trace(path).read("/x")["x"].tolist()
    return found


def test_rows_of_a_run_that_died_are_set_aside(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Each of several, told with the line that recovers it; a whole one at last is beside them."""
    path = tmp_path / "a.mcap"
    for value in (1.0, 2.0, 3.0):
        write(path, [value], finish=False)
    write(path, [4.0])
    printed = capfd.readouterr().err
    assert {x.name for x in tmp_path.iterdir()} == {
        *("a.mcap", "a.mcap.partial.1", "a.mcap.partial.2", "a.mcap.partial.3")
    }
    assert values(path) == [4.0]
    for number, value in ((1, 1.0), (2, 2.0), (3, 3.0)):
        aside = tmp_path / f"a.mcap.partial.{number}"
        assert f"cosim trace recover {aside}" in printed
        recover(aside, tmp_path / "mended.mcap", force=True)
        assert values(tmp_path / "mended.mcap") == [value]


def test_a_cut_file_with_half_a_chunk_is_set_aside(tmp_path: Path) -> None:
    path, partial = tmp_path / "a.mcap", tmp_path / "a.mcap.partial"
    write(path, [float(k) for k in range(1000)])
    partial.write_bytes(path.read_bytes()[:-900])
    write(path, [1.0])
    assert (tmp_path / "a.mcap.partial.1").exists()


def test_nothing_is_kept_of_a_run_without_rows(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, [], finish=False)
    assert (tmp_path / "a.mcap.partial").exists()
    write(path, [1.0])
    (tmp_path / "a.mcap.partial").write_bytes(b"")
    write(path, [2.0])
    assert {x.name for x in tmp_path.iterdir()} == {"a.mcap"}


def test_what_is_no_trace_is_not_erased(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.partial").write_text("mine")
    write(tmp_path / "a.mcap", [1.0])
    assert (tmp_path / "a.mcap.partial.1").read_text() == "mine"


def test_a_link_in_the_place_of_the_partial_file_is_not_followed(tmp_path: Path) -> None:
    """A hard one neither: the file has another name, under which it stays as it is."""
    mine = tmp_path / "mine"
    mine.write_text("mine")
    partial = tmp_path / "a.mcap.partial"
    partial.symlink_to(mine)
    with pytest.raises(InputError, match="no regular file"):
        TraceWriter(tmp_path / "a.mcap", run={})
    partial.unlink()
    partial.hardlink_to(mine)
    write(tmp_path / "a.mcap", [1.0])
    assert mine.read_text() == "mine"


def test_a_link_in_the_place_of_the_trace_stays(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    link, aim = tmp_path / "a.mcap", tmp_path / "disk" / "b.mcap"
    link.symlink_to(aim)
    for value in (1.0, 2.0):
        write(link, [value])
        assert link.is_symlink()
        assert values(aim) == [value]
    assert [x.name for x in aim.parent.iterdir()] == ["b.mcap"]


def test_a_trace_is_not_written_into_a_pipe_or_device(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, what in ((pipe, "a pipe"), (Path(os.devnull), "a device")):
        before = path.stat()
        with pytest.raises(InputError, match=what):
            TraceWriter(path, run={})
        assert (path.stat().st_ino, path.stat().st_mode) == (before.st_ino, before.st_mode)
        assert not path.with_name(f"{path.name}.partial").exists()
    assert stat.S_ISFIFO(pipe.stat().st_mode)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files to others")
def test_the_partial_file_of_another_user_is_not_written_into(tmp_path: Path) -> None:
    """Who may write to the folder could have put it there to read or change the trace."""
    partial = tmp_path / "a.mcap.partial"
    partial.write_bytes(b"")
    os.chown(partial, 12345, 12345)
    with pytest.raises(InputError, match="another user"):
        TraceWriter(tmp_path / "a.mcap", run={})
    assert partial.read_bytes() == b""


@pytest.mark.skipif(os.name == "nt", reason="no open file can be removed there")
@pytest.mark.parametrize("fsync", [False, True])
@pytest.mark.parametrize("there", [False, True])
@pytest.mark.parametrize("what", ["file", "folder", "another"])
def test_a_partial_file_that_is_removed_meanwhile_is_written_all_the_same(
    tmp_path: Path, what: str, *, fsync: bool, there: bool
) -> None:
    """With its folder, or for another run of the same name, whose file stays its own."""
    path = tmp_path / "in" / "a.mcap"
    if there:
        write(path, [0.0])
    with TraceWriter(path, run={}, fsync=fsync) as writer:
        topic = writer.add_topic("/x", [Signal("x")], schema_name="t.X")
        writer.write(topic, 0, [1.0])
        writer.flush()
        if what == "folder":
            shutil.rmtree(path.parent)
        else:
            writer.partial_path.unlink()
        if what == "another":
            writer.partial_path.write_text("another's")
        writer.write(topic, 1, [2.0])
        writer.finish({})
    assert values(path) == [1.0, 2.0]
    assert verify(path).verdict == "ok"
    beside = {x.name: x for x in path.parent.iterdir()}
    assert beside.pop("a.mcap")
    assert [x.read_text() for x in beside.values()] == ["another's"] * (what == "another")


@pytest.mark.skipif(os.name == "nt", reason="no open file can be removed there")
def test_a_partial_file_that_cannot_be_written_again_is_a_named_loss(tmp_path: Path) -> None:
    """It is not said to be there."""
    path = tmp_path / "in" / "a.mcap"
    writer = TraceWriter(path, run={})
    writer.partial_path.unlink()
    path.parent.rmdir()
    path.parent.write_text("no folder")
    with pytest.raises(LossError, match="could not be written") as caught:
        writer.finish({})
    assert caught.value.hint is not None
    assert "is gone" in caught.value.hint
    writer.close()


@pytest.mark.skipif(not hasattr(os, "O_DIRECTORY"), reason="no folders are flushed there")
def test_a_folder_that_cannot_be_flushed_is_a_named_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The trace is complete by then, and stays."""
    path = tmp_path / "a.mcap"
    real = os.fsync

    def fsync(descriptor: int) -> None:
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EIO, "no luck")
        real(descriptor)

    with TraceWriter(path, run={}, fsync=True) as writer:
        monkeypatch.setattr(os, "fsync", fsync)
        with pytest.raises(LossError, match="no luck"):
            writer.finish({})
    assert verify(path).verdict == "ok"
