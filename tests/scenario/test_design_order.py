"""An order in [design] must prove what a link needs: every age up to the delay."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.core import NotAchievableError
from cosim.scenario import FmuCache, PreparedScenario, execute_unrecorded, load, prepare

MASS = """
[system]
A = [[0.0, 1.0], [0.0, -0.1]]
B = [[0.0], [1.0]]
C = [[0.0], [1.0]]
D = [[1.0, 0.0], [0.0, 0.0]]
D2 = [[0.0], [0.1]]
[[system.delays]]
d = 1.0
feedback = true
any_age = {}
"""
INNER = """
[[system.delays]]
d = 0.4
A = [[0.0, 0.0], [0.0, -0.2]]
"""
SCENARIO = """
title = "A mass controlled over a delay of one second"
connect = ["plant.x -> controller.x", "controller.u -> plant.u"]
[run]
end = 0.5
step = 0.1
[components.plant]
fmu = "DelayedPlant"
[components.controller]
fmu = "PaperController"
[design]
system = "mass.toml"
"""


def prepared(folder: Path, fmus: Path, system: str, *settings: str) -> PreparedScenario:
    """The scenario with a design of a system."""
    (folder / "mass.toml").write_text(system, "utf-8")
    (folder / "s.toml").write_text(SCENARIO, "utf-8")
    loaded = load(str(folder / "s.toml"), settings)
    return prepare(loaded, FmuCache(fmus.parent, folder, flavour="native"), of_links=False)


def test_order_that_proves_one_age_only_is_refused(native_fmus: Path, tmp_path: Path) -> None:
    """At the least gamma of order 1 a constant delay is proved at exactly its length: refused."""
    given = ("design.k1=[-0.5]", "design.k2=[1.0]", "design.order=1")
    with pytest.raises(NotAchievableError, match="exactly one age"):
        prepared(tmp_path, native_fmus, MASS.format("false"), *given)


def test_delay_of_any_age_is_designed_at_order_0(native_fmus: Path, tmp_path: Path) -> None:
    """There the order is 0 in all cases, and every age up to the delay is covered."""
    found = prepared(tmp_path, native_fmus, MASS.format("true"), "design.order=1").design
    assert found is not None
    assert found.covers_smaller_delays
    assert found.order == 1


def test_a_constant_delay_in_the_plant_may_be_proved_exactly(
    native_fmus: Path, tmp_path: Path
) -> None:
    """Beside feedback of any age; a run is then covered with that delay, not with a shorter one."""
    system = MASS.format("true").replace("[[system.delays]]", f"{INNER}\n[[system.delays]]")
    gain = "design.gain=[[-0.2,-0.6]]"
    for order, covered in ((1, [0.4]), (0, [0.3, 0.4])):
        designed = prepared(tmp_path, native_fmus, system, gain, f"design.order={order}")
        assert designed.design is not None
        assert designed.problem is not None
        found = []
        for d in (0.3, 0.4, 0.5):
            own = f'components.plant.parameters={{"delay.d"={d}, "A1[2,2]"=-0.2}}'
            loaded = load(str(tmp_path / "s.toml"), [own])
            cache = FmuCache(native_fmus.parent, tmp_path, flavour="native")
            saved = designed.problem, designed.design
            metrics = execute_unrecorded(prepare(loaded, cache, saved=saved))[0].metrics
            apart = {one["place"] for one in metrics.get("departures", ())}
            found += [] if "plant.delay.d" in apart else [d]
        assert found == covered
