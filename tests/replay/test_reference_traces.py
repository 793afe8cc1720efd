"""Reference traces: still readable, still the same run."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import BUILT_IN, cosim
from shared import fmu_store

from cosim.hinf import Result
from cosim.hinf.certificate import certificate_from_bytes
from cosim.hinf.delay_lti import worst_case_from_json
from cosim.replay import rerun
from cosim.scenario import FmuCache, execute_run, parse, prepare, problem_of
from cosim.trace import Trace
from cosim.trace.rows import DESIGN_ATTACHMENT, SCENARIO_ATTACHMENT

KEPT = sorted(Path(__file__).parents[2].joinpath("traces", "reference").glob("*.mcap"))
MOST_BYTES = 1_000_000


def executed_again(path: Path, target: Path) -> bool:
    """The run of a kept trace again, to `target`; whether with the very FMUs of then.

    FMUs of an earlier version cannot be built any more: then the scenario is flown with today's,
    and the gain that the trace carries.
    """
    kept = Trace(path)
    fmu_cache = FmuCache(root=fmu_store(), folder=target.parent)
    built = {hashlib.sha256(f.read_bytes()).hexdigest() for f in fmu_cache.root.rglob("*.fmu")}
    if {v for k, v in kept.run.items() if k.startswith("fmu.") and k.endswith(".sha256")} <= built:
        rerun(path, fmu_cache, output=target)
        return True
    text = kept.attachments[SCENARIO_ATTACHMENT].decode()
    loaded = parse(text, name=path.stem, where=path.name, folder=target.parent)
    part = loaded.scenario.design
    assert part is not None
    gain = Result.from_json(json.loads(kept.attachments[DESIGN_ATTACHMENT]), where=path.name)
    saved, worst_case = (problem_of(part, target.parent), gain), None
    if (recorded := kept.run.get("disturbance")) is not None:
        data = certificate_from_bytes(recorded.encode(), path.name)  # it has all digits
        worst_case = worst_case_from_json(data, path.name, gain.system.C.shape[1])
    execute_run(prepare(loaded, fmu_cache, saved=saved, worst_case=worst_case), target)
    return False


def same_machine(kept: Trace, now: Trace) -> bool:
    """Whether the last bit of a sine may be expected to be the same."""
    keys = ("host.python", "host.numpy")
    there = [kept.run[key] for key in keys] + kept.run["host.platform"].split("-")[-1:]
    here = [now.run[key] for key in keys] + now.run["host.platform"].split("-")[-1:]
    return [part.removeprefix("glibc") for part in there] == [
        part.removeprefix("glibc") for part in here
    ]


def close(old: Any, new: Any, where: str) -> None:
    """Compare recorded metrics with new ones, numbers to nine digits."""
    if isinstance(old, Mapping):
        for key, value in old.items():
            close(value, new[key], f"{where}.{key}")
    elif isinstance(old, float) and isinstance(new, int | float):
        assert new == pytest.approx(old, rel=1e-9, abs=1e-9), where
    else:
        assert new == old, where


def test_every_built_in_scenario_is_kept() -> None:
    """One of each, all of them small."""
    assert {path.stem for path in KEPT} == set(BUILT_IN)
    assert sum(path.stat().st_size for path in KEPT) < MOST_BYTES


def test_the_readme_names_each(tmp_path: Path) -> None:
    """Name and content hash, as `cosim trace info` finds it."""
    text = Path(__file__).parents[2].joinpath("traces", "README.md").read_text("utf-8")
    for path in KEPT:
        reported = cosim("trace", "info", path, "--json", cwd=tmp_path).json
        assert f"`{path.stem}`" in text
        assert reported["content_hash"][:12] in text


@pytest.mark.parametrize("path", KEPT, ids=lambda path: path.stem)
def test_the_run_is_still_the_same(path: Path, tmp_path: Path) -> None:
    """Every signal at the same instants: bit for bit with the FMUs of then, else nine digits."""
    same_fmus = executed_again(path, tmp_path / "again.mcap")
    kept, now = Trace(path), Trace(tmp_path / "again.mcap")
    exact = same_fmus and same_machine(kept, now)
    assert kept.finished
    assert kept.run["scenario"] == now.run["scenario"] == path.stem
    rows = [t for t in kept.topics if t.endswith(("/input", "/output")) or "/link/" in t]
    assert len(rows) > 3
    for topic in rows:
        if not kept.topics[topic].count:
            assert not now.topics[topic].count
            continue
        old, new = kept.read(topic), now.read(topic)
        assert np.array_equal(old.log_time_ns, new.log_time_ns), topic
        assert np.array_equal(old.publish_time_ns, new.publish_time_ns), topic
        assert np.array_equal(old.sequence, new.sequence), topic
        for name, values in old.columns.items():
            if exact or values.dtype.kind == "O":
                assert np.array_equal(new[name], values), (topic, name)
            else:
                assert new[name] == pytest.approx(values, rel=1e-9, abs=1e-9), (topic, name)
    assert kept.result is not None
    assert now.result is not None
    assert now.result["status"] == kept.result["status"]
    close(json.loads(kept.result["metrics"]), json.loads(now.result["metrics"]), "metrics")
