"""A scenario gives the same run with native and with Python FMUs."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from unittest.mock import patch

import pytest
from cli.shell import cosim, trace_of
from shared import fmu_store

from cosim.trace import Trace


@pytest.mark.skipif(sys.platform != "linux", reason="Python and the FMU must call one C library")
@pytest.mark.parametrize("name", ["auv-acoustic", "paper-example"])
def test_python_fmus_give_the_same_bits(tmp_path: Path, name: str) -> None:
    """Every message of every topic: times, sequence and values."""
    trace = tmp_path / "python.mcap"
    words = ("run", name, "--flavour", "python", "--fmus", fmu_store("python"), "--out", trace)
    result = cosim(*words, "--json", cwd=tmp_path)
    assert result.code == 0, result.err
    origins = set(result.json["binaries"].values())
    assert origins == {f"from {fmu_store('python') / 'python'}", "compiled on this machine"}
    python, native = Trace(trace), Trace(trace_of(name))
    kinds = [
        {channel.topic for channel, *_ in each.messages() if channel.topic != "/log"}
        for each in (native, python)
    ]
    assert kinds[0] == kinds[1]
    assert len(kinds[0]) > 3
    seen = [
        [
            (channel.topic, times, bytes(data))
            for channel, *times, data in each.messages()
            if channel.topic != "/log"
        ]
        for each in (native, python)
    ]
    assert seen[0] == seen[1]


def test_without_a_compiler_no_other_flavour_is_run(tmp_path: Path) -> None:
    """The default flavour cannot be had: an error in words, and no fall back."""
    with patch.dict(os.environ, {"CC": "no-such-compiler"}):
        result = cosim("run", "paper-example", "--json", cwd=tmp_path)
    assert result.code == 2
    assert "C compiler" in result.error["what"]
    assert "this installation has no prebuilt binaries" in result.error["got"]
    assert not list(tmp_path.rglob("*.fmu"))
