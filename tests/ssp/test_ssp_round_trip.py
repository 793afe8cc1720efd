"""Every built-in scenario, exported and imported again: the same run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared import fmu_store, slow_share_of
from ssp.archives import Links

from cosim.master import Session, System
from cosim.scenario import (
    FmuCache,
    LoadedScenario,
    SspVersion,
    assembled_system,
    builtin_names,
    export_ssp,
    import_ssp,
    load,
    prepare,
)

FORMS: tuple[tuple[Links, SspVersion], ...] = (
    ("annotate", "1.0"), ("fmu", "1.0"), ("annotate", "2.0"), ("fmu", "2.0"),
)  # fmt: skip
BEGINNING_S = 4.0
"""So much of each is flown by default, and all of it when slow tests run."""
PART = [(name, *FORMS[i % 4], False) for i, name in enumerate(builtin_names())]
WHOLE = [(name, *form, True) for name in builtin_names() for form in FORMS]
KEPT = ("events", "modes", "assertions", "medium", "record", "inputs")
"""Tables that no other tool has."""
FROM_THE_DESIGN = ("auv-worst-case", "paper-worst-case")
"""Their disturbance comes back as a component, and its constant parts as start values."""


def system_of(scenario: LoadedScenario) -> System:
    cache = FmuCache(fmu_store(), scenario.folder)
    return assembled_system(prepare(scenario, cache))[0]


@pytest.mark.parametrize(("name", "links", "version", "whole"), [*PART, *slow_share_of(WHOLE)])
def test_what_comes_back_flies_the_same(
    tmp_path: Path, name: str, links: Links, version: SspVersion, *, whole: bool
) -> None:
    """Every value of every component at every point, and what the links did.

    An archive with link FMUs steps on the grid, so that its judge does.
    """
    scenario = load(name)
    prepared = prepare(scenario, FmuCache(fmu_store(), tmp_path))
    done = export_ssp(prepared, tmp_path / "a.ssp", links, version)
    again = import_ssp(done.path, tmp_path / "again.toml")
    if links == "fmu":
        run = scenario.scenario.run.model_copy(update={"events": "grid"})
        on_grid = scenario.scenario.model_copy(update={"run": run})
        scenario = replace(scenario, scenario=on_grid)
    back = load(str(again.path))
    before_it, after_it = scenario.scenario.to_data(), back.scenario.to_data()
    assert [key for key in KEPT if after_it.get(key) != before_it.get(key)] == []
    ours, theirs = system_of(scenario), system_of(back)
    more = {*theirs.components} - {*ours.components}
    assert more == ({"signals"} if name in FROM_THE_DESIGN else set())
    with Session(ours) as one, Session(theirs) as other:
        for session in (one, other):
            session.go_on() if whole else session.run_until(BEGINNING_S)
        before, after = one.run_so_far(), other.run_so_far()
        assert (after.status, after.reason) == (before.status, before.reason)
        assert np.array_equal(after.points_ns, before.points_ns)
        assert after.statistics == before.statistics
        for component, variable in recorded(ours):
            if name in FROM_THE_DESIGN and variable.startswith(("disturbance", "w")):
                continue
            values = before.signal(component, variable)
            assert np.array_equal(after.signal(component, variable), values), variable


def recorded(system: System) -> list[tuple[str, str]]:
    """Every output, and every input that something feeds."""
    outputs = [
        (name, port.name)
        for name, component in system.components.items()
        for port in component.description.ports.values()
        if port.causality == "output"
    ]
    fed = [*system.driven, *(connection.target for connection in system.connections)]
    return [*outputs, *((end.component, end.variable) for end in fed)]
