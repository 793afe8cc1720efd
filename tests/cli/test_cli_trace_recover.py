"""`cosim trace recover` and `cosim trace verify` as a shell sees them."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli.shell import cosim, trace_of
from shared import fmu_store

from cosim.trace import Signal, TraceWriter


def test_recover_says_what_it_did(tmp_path: Path) -> None:
    """Exit code 3 and the figures when something is lost, 0 when nothing is."""
    with TraceWriter(tmp_path / "a.mcap", run={"seed": "1"}, chunk_bytes=500) as writer:
        topic = writer.add_topic("/x", [Signal("x")], schema_name="t.X")
        for k in range(1000):
            writer.write(topic, k, [k])
        whole = writer.finish({}).read_bytes()
    cut = tmp_path / "cut.mcap.partial"
    cut.write_bytes(whole[: len(whole) // 2])
    done = cosim("trace", "recover", cut, "--json", cwd=tmp_path)
    assert done.code == 3, done.err
    reported = done.json
    assert Path(reported["output"]) == tmp_path / "cut.recovered.mcap"
    assert reported["lost_messages"] is None
    assert reported["messages"] > 0
    assert reported["damage"][0]["position"] < len(whole) // 2
    info = cosim("trace", "info", reported["output"], "--json", cwd=tmp_path).json
    assert (info["complete"], info["finished"]) == (True, False)
    assert info["message_count"] == reported["messages"]

    again = cosim("trace", "recover", cut, cwd=tmp_path)
    assert again.code == 2
    assert "exists" in again.err
    cut.write_bytes(whole[:-3])  # the closing magic alone
    mended = cosim("trace", "recover", cut, "--out", "b.mcap", "--json", cwd=tmp_path)
    assert (mended.code, mended.json["lost_messages"]) == (0, 0)
    people = cosim("trace", "recover", cut, "-o", "b.mcap", "--force", cwd=tmp_path)
    assert people.code == 0
    assert "b.mcap" in people.out
    fine = cosim("trace", "recover", trace_of("paper-example"), cwd=tmp_path)
    assert (fine.code, "nothing to recover" in fine.out) == (0, True)


def test_recover_refuses_what_is_no_trace(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"PK")
    for file in ("a.mcap", "none.mcap", "."):
        assert cosim("trace", "recover", file, "--json", cwd=tmp_path).error["exit_code"] == 2


@pytest.mark.parametrize("name", ["paper-example", "auv-acoustic"])
def test_verify_accepts_a_run(name: str, tmp_path: Path) -> None:
    """A run of ours passes every check, its FMUs are found; cut or changed, it does not."""
    trace = trace_of(name)
    done = cosim("trace", "verify", trace, "--fmus", fmu_store(), "--json", cwd=tmp_path)
    assert done.code == 0, done.out
    reported = done.json
    assert (reported["verdict"], reported["ok"], reported["ours"]) == ("ok", True, True)
    names = {check["name"] for check in reported["checks"]}
    assert {"checksums", "result", "certificate", "FMU files", "order"} <= names
    assert "all checks passed" in cosim("trace", "verify", trace, cwd=tmp_path).out

    whole = trace.read_bytes()
    other = tmp_path / "other.mcap"
    other.write_bytes(whole[:-5000])
    assert cosim("trace", "verify", other, cwd=tmp_path).code == 3
    half = len(whole) // 2
    other.write_bytes(whole[:half] + bytes([whole[half] ^ 4]) + whole[half + 1 :])
    bad = cosim("trace", "verify", other, "--json", cwd=tmp_path)
    assert bad.code == 1
    assert bad.json["verdict"] == "failed"


def test_verify_refuses_what_is_no_trace(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"PK")
    for file in ("a.mcap", "none.mcap", "."):
        assert cosim("trace", "verify", file, "--json", cwd=tmp_path).error["exit_code"] == 2
