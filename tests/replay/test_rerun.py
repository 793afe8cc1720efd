"""Rerun from a trace alone: identical, different or refused."""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from cli.shell import BUILT_IN, SCENARIOS, cosim, shared_run, trace_of
from shared import copied, fmu_store, sampled, slow_share_of

from cosim.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Callable


def tampered(source: Path, target: Path, **changes: Callable[[bytes], bytes]) -> Path:
    """A whole, valid copy of a trace with some of its attachments and run entries changed.

    `scenario`, `design` change an attachment; `run` changes the JSON of `cosim.run`'s entries.
    """
    from mcap.reader import make_reader  # noqa: PLC0415
    from mcap.writer import Writer  # noqa: PLC0415

    names = {"scenario.toml": "scenario", "design.json": "design"}
    with source.open("rb") as stream, target.open("wb") as out:
        reader, writer = make_reader(stream), Writer(out)
        header = reader.get_header()
        writer.start(profile=header.profile, library=header.library)
        for entries in reader.iter_metadata():
            data = dict(entries.metadata)
            if entries.name == "cosim.run" and "run" in changes:
                data = json.loads(changes["run"](json.dumps(data).encode()))
            writer.add_metadata(entries.name, data)
        for record in reader.iter_attachments():
            change = changes.get(names.get(record.name, ""), bytes)
            writer.add_attachment(
                record.create_time,
                record.log_time,
                record.name,
                record.media_type,
                change(record.data),
            )
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.id not in channels:
                assert schema is not None
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schema_id, channel.metadata
                )
            writer.add_message(
                channels[channel.id],
                message.log_time,
                message.data,
                message.publish_time,
                message.sequence,
            )
        writer.finish()  # type: ignore[no-untyped-call]
    return target


@pytest.mark.parametrize("name", sampled(BUILT_IN, 1))
def test_every_built_in_scenario_reruns_identically(name: str, tmp_path: Path) -> None:
    """From another folder, with nothing but the trace: every message again, bit for bit."""
    path = tmp_path / "given.mcap"
    copied(trace_of(name), path)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    result = cosim("trace", "rerun", path, "--json", cwd=elsewhere)
    assert result.code == 0, result.err
    data = result.json
    assert data["identical"] is True
    assert data["differences"] == []
    assert data["original_hash"] == shared_run(name).json["content_hash"]
    assert data["rerun"]["metrics"] == shared_run(name).json["metrics"]
    assert sorted(p.name for p in elsewhere.iterdir()) == ["fmus"]


def test_new_trace_is_kept_where_asked(tmp_path: Path) -> None:
    """`--out` keeps the run again; it can itself be run again."""
    again = tmp_path / "again.mcap"
    fmus = ("--fmus", fmu_store())
    first = cosim("trace", "rerun", trace_of("paper-example"), "--out", again, *fmus, cwd=tmp_path)
    assert first.code == 0, first.err
    assert "identical" in first.out
    second = cosim("trace", "rerun", again, "--json", *fmus, cwd=tmp_path)
    assert second.json["identical"] is True


def swapped(old: bytes, new: bytes) -> Callable[[bytes], bytes]:
    """Replace a text that is there."""

    def change(data: bytes) -> bytes:
        assert old in data
        return data.replace(old, new)

    return change


def rehashed(source: Path, key: str, attachment: str, change: Callable[[bytes], bytes]) -> bytes:
    """The hash that a careful forger would put into `cosim.run` for a changed attachment."""
    trace = Trace(source)
    assert trace.run[key] == hashlib.sha256(trace.attachments[attachment]).hexdigest()
    return hashlib.sha256(change(trace.attachments[attachment])).hexdigest().encode()


TAMPERED = {
    "scenario": (
        swapped(b"seed = 1", b"seed = 2"),
        "scenario.toml in this trace is not that of its run",
    ),
    "design": (swapped(b'"paper"', b'"other"'), "design.json in this trace is not that of its run"),
}


@pytest.mark.parametrize("what", TAMPERED)
def test_changed_attachment_is_refused(what: str, tmp_path: Path) -> None:
    """A scenario or design that is not the one whose hash the trace names."""
    change, message = TAMPERED[what]
    path = tampered(trace_of("paper-example"), tmp_path / "t.mcap", **{what: change})
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 2
    assert message in result.error["what"]
    assert result.error["expected"].startswith("SHA-256")


def test_proof_that_does_not_hold_is_refused(tmp_path: Path) -> None:
    """Another gain under the same proof, its hash forged too: the proof is checked again."""
    source, change = trace_of("paper-example"), swapped(b"0.6432", b"0.7432")
    forged = rehashed(source, "design.sha256", "design.json", change)
    true = Trace(source).run["design.sha256"].encode()
    path = tampered(source, tmp_path / "t.mcap", design=change, run=swapped(true, forged))
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 2
    assert "proof" in result.error["what"]


def test_design_of_another_system_is_refused(tmp_path: Path) -> None:
    """A valid proof about another vehicle, its hash forged too."""
    source = trace_of("auv-acoustic")
    other = Trace(trace_of("auv-direct")).attachments["design.json"]
    true = Trace(source).run["design.sha256"].encode()
    forged = hashlib.sha256(other).hexdigest().encode()
    path = tampered(
        source, tmp_path / "t.mcap", design=lambda _: bytes(other), run=swapped(true, forged)
    )
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 2
    assert "another system" in result.error["what"]


def test_other_scenario_differs(tmp_path: Path) -> None:
    """Another disturbance with a forged hash: exit 1, and where the runs part."""
    source, change = (
        trace_of("paper-example"),
        swapped(b'"amplitude[1]" = 1.0', b'"amplitude[1]" = 2.0'),
    )
    forged = rehashed(source, "scenario.sha256", "scenario.toml", change)
    true = Trace(source).run["scenario.sha256"].encode()
    path = tampered(source, tmp_path / "t.mcap", scenario=change, run=swapped(true, forged))
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 1
    assert result.json["identical"] is False
    assert any(line.startswith("/plant/output x[1]") for line in result.json["differences"])
    seen = cosim("trace", "rerun", path, "--fmus", fmu_store(), cwd=tmp_path)
    assert seen.code == 1
    assert "not identical" in seen.out


def test_other_fmu_is_refused(fmus: Path, tmp_path: Path) -> None:
    """A component whose bytes are not those of the run, though its name and GUID are.

    Where the FMU of the run lies among the others, it is found by its hash.
    """
    text = (SCENARIOS / "valid" / "plain.toml").read_text().replace('"PaperController"', '"c.fmu"')
    (tmp_path / "s.toml").write_text(text)
    copied(fmus / "PaperController.fmu", tmp_path / "c.fmu")
    root = ("--fmus", fmus.parent)
    ran = cosim("run", "s.toml", "--json", *root, cwd=tmp_path)
    assert ran.code == 0, ran.err
    same = cosim("trace", "rerun", ran.json["trace"], "--json", *root, cwd=tmp_path)
    assert same.json["identical"] is True
    with zipfile.ZipFile(tmp_path / "c.fmu", "a") as archive:
        archive.writestr("extra/note.txt", "one byte more is another FMU")
    found = cosim("trace", "rerun", ran.json["trace"], "--json", *root, cwd=tmp_path)
    assert found.json["identical"] is True
    result = cosim("trace", "rerun", ran.json["trace"], "--json", cwd=tmp_path)
    assert result.code == 2
    assert "not the one in the trace" in result.error["what"]
    assert "c.fmu" in result.error["where"]


def test_design_for_a_system_in_a_file_needs_only_the_trace(fmus: Path, tmp_path: Path) -> None:
    """[design] with a system FILE.toml beside the scenario: the trace carries it."""
    folder = tmp_path / "here"
    folder.mkdir()
    plain = (SCENARIOS / "valid" / "plain.toml").read_text()
    (folder / "s.toml").write_text(plain + '\n[design]\nsystem = "mine.toml"\n')
    (folder / "mine.toml").write_text(
        "[system]\nA = [[-5.0, 0.0], [6.0, -10.0]]\nA1 = [[-1.0, 0.0], [2.0, 1.0]]\n"
        "B = [[-1.0], [3.0]]\nC = [[4.0], [3.0]]\nD = [[-1.0, 0.0], [0.0, -1.0]]\n"
        "D1 = [[4.0], [3.0]]\nD2 = [[3.0], [-1.0]]\nd = 0.3\n"
        "[design]\nk1 = [0.6]\nk2 = [0.2]\n"
    )
    root = ("--fmus", fmus.parent)
    # from another folder than the scenario's: its files are looked up beside it
    ran = cosim("run", "here/s.toml", "--out", "t.mcap", "--json", *root, cwd=tmp_path)
    assert ran.code == 0, ran.err
    assert ran.json["metrics"]["gamma"] > 5.0
    shutil.rmtree(folder)
    result = cosim("trace", "rerun", "t.mcap", "--json", *root, cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["identical"] is True


def test_foreign_mcap_cannot_be_run_again(tmp_path: Path) -> None:
    """An MCAP file of somebody else: said to be a trace, but not one of ours."""
    from mcap.writer import Writer  # noqa: PLC0415

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="other")
        writer.finish()  # type: ignore[no-untyped-call]
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 2
    assert "cannot be run again" in result.error["what"]
    assert cosim("trace", "info", path, "--json", cwd=tmp_path).code == 0


def cut(source: Path, target: Path, share: float) -> Path:
    """What is left of a trace whose process was killed: the first part of its bytes."""
    data = source.read_bytes()
    target.write_bytes(data[: int(len(data) * share)])
    return target


@pytest.mark.parametrize("share", sampled([0.4, 0.85], 1))
def test_a_trace_cut_short_equals_the_beginning_of_its_rerun(tmp_path: Path, share: float) -> None:
    """Every message that there is comes out again; a changed one is found."""
    path = cut(trace_of("auv-acoustic"), tmp_path / "r.mcap.partial", share)
    fmus = ("--fmus", fmu_store())
    assert Trace(path).topics["/plant/output"].count > 100
    result = cosim("trace", "rerun", path, "--json", *fmus, cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["identical"] is True
    assert (result.json["finished"], result.json["differences"]) == (False, [])
    assert "did not finish" in cosim("trace", "rerun", path, *fmus, cwd=tmp_path).out


def test_a_cut_run_of_another_seed_differs(tmp_path: Path) -> None:
    """Another scenario under a forged hash, and the end cut off."""
    source, change = trace_of("auv-acoustic"), swapped(b"Hs = 1.0", b"Hs = 1.5")
    forged = rehashed(source, "scenario.sha256", "scenario.toml", change)
    true = Trace(source).run["scenario.sha256"].encode()
    whole = tampered(source, tmp_path / "t.mcap", scenario=change, run=swapped(true, forged))
    path = cut(whole, tmp_path / "t.mcap.partial", 0.7)
    result = cosim("trace", "rerun", path, "--json", "--fmus", fmu_store(), cwd=tmp_path)
    assert result.code == 1
    assert result.json["identical"] is False
    assert any(line.startswith("/sea/output disturbance") for line in result.json["differences"])


@pytest.mark.skipif(sys.platform != "linux", reason="a compiler is there, as for other tests")
@pytest.mark.parametrize(
    "name",
    slow_share_of(["paper-example", *(n for n in BUILT_IN if n[0] == "a")]),
)
def test_a_native_run_reruns_identically_without_its_fmus(name: str, tmp_path: Path) -> None:
    """The flavour that flew is known by its hash alone: it is built again, and is the same."""
    ran = cosim("run", name, "--flavour", "native", "--json", cwd=tmp_path)
    assert ran.code == 0, ran.err
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    again = cosim("trace", "rerun", tmp_path / ran.json["trace"], "--json", cwd=elsewhere)
    assert again.code == 0, again.err
    assert again.json["identical"] is True
    assert again.json["original_hash"] == ran.json["content_hash"]


@pytest.mark.slow
def test_an_fmu_is_found_by_its_hash_in_any_folder(fmus: Path, tmp_path: Path) -> None:
    """Below --fmus, however deep and whatever it is called; nothing is built for it."""
    ran = trace_of("paper-example")
    store = tmp_path / "store" / "a" / "b"
    store.mkdir(parents=True)
    names = {"DelayedPlant": "one.fmu", "PaperController": "two.fmu"}
    recorded = Trace(ran).run
    for component, number in (("plant", "one"), ("controller", "two")):
        name = recorded[f"fmu.{component}"]
        copied(fmus / f"{name}.fmu", store / names.get(name, f"{number}.fmu"))
    result = cosim("trace", "rerun", ran, "--json", "--fmus", tmp_path / "store", cwd=tmp_path)
    assert result.code == 0, result.err
    assert result.json["identical"] is True
