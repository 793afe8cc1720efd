"""Traces that were kept: still readable, still the same run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.shell import trace_of

from cosim.trace import Trace

KEPT = sorted(Path(__file__).parents[2].joinpath("traces", "reference").glob("*.mcap"))


def test_there_are_kept_traces() -> None:
    """The folder has not been emptied."""
    assert KEPT


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_the_run_is_still_the_same(path: Path) -> None:
    """Every signal of every component, at the same instants, to nine digits."""
    kept, now = Trace(path), Trace(trace_of(path.stem))
    assert kept.finished
    assert kept.run["scenario"] == path.stem
    rows = [t for t in kept.topics if t.endswith(("/input", "/output"))]
    assert rows
    for topic in rows:
        old, new = kept.read(topic), now.read(topic)
        assert np.array_equal(old.log_time_ns, new.log_time_ns)
        for name, values in old.columns.items():
            assert new[name] == pytest.approx(values, rel=1e-9, abs=1e-9), (topic, name)
