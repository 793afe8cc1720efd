"""Study files that are wrong, each named with its place; and those that are right."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim.core import InputError
from cosim.scenario import load
from cosim.study import Plan, Study, builtin_studies, load_study, plan_of

HERE = Path(__file__).parent
SAYS = {
    "bad-expression": (7, "column 5: there is no name 'y'"),
    "bad-linspace": (10, "at least 3 items"),
    "bad-logspace": (7, "between positive numbers"),
    "bad-path": (7, "not a path: 'run..step'"),
    "empty-metrics": (9, "the value of 'metrics' is not allowed"),
    "empty-values": (10, "'vary[0].values' is not allowed"),
    "fractional-count": (7, "a whole count"),
    "malformed": (4, "malformed TOML"),
    "metric-value-unknown": (4, "twice, column 5: there is no name 'gin'"),
    "metric-of-both": (10, "either a path or a signal"),
    "metric-without-reduce": (10, "signal and reduce belong together"),
    "misspelt-key": (10, "did you mean values"),
    "moved-twice": (12, "two axes change run.step"),
    "no-axes": (None, "the key 'vary' is missing"),
    "no-kind": (7, "which kind"),
    "no-list": (7, "connections[7].policy leads nowhere"),
    "no-metrics": (None, "the key 'metrics' is missing"),
    "no-such-file": (None, "nowhere.toml"),
    "no-target": (7, "one of path, paths, apply"),
    "reserved-column": (10, "two columns 'status'"),
    "reversed-bounds": (9, "uniform is [low, high]; got [0.2, 0.1]"),
    "same-column": (10, "two columns 'run.step'"),
    "samples-of-nothing": (3, "needs an axis to draw"),
    "set-nowhere": (13, "did you mean end"),
    "set-wrong-value": (13, "run.end"),
    "settling-without-band": (10, "within is the band"),
    "strange-name": (6, "the name of a column: a letter, then"),
    "stability-of-nothing": (13, "there is no axis 'dely'"),
    "too-many": (7, "100000000"),
    "traces-by-nothing": (3, "did you mean gain"),
    "two-distributions": (9, "got uniform and normal"),
    "two-targets": (7, "got path and paths"),
    "uneven-rows": (7, "one value per entry of paths: 2"),
    "unknown-component": (7, "did you mean plant"),
    "unknown-kind": (
        7,
        "'sobol' or 'latin' or 'saltelli' or 'replicates'",
    ),
    "unknown-link": (7, "links has nothing"),
    "unknown-parameter": (7, "did you mean F.amplitude"),
    "unknown-path": (7, "did you mean step"),
    "unknown-reduction": (10, "'growth_rate'"),
    "unknown-scenario": (None, "did you mean paper-example"),
    "wrong-traces": (3, "worst:N by METRIC"),
    "wrong-type": (3, "a whole number"),
}
"""File -> the line that the message names, and words of it."""


def planned(name_or_path: str, native_fmus: Path) -> Plan:
    """A study from its file to its plan."""
    loaded = load_study(name_or_path)
    return plan_of(loaded.study, loaded.base, loaded.place, fmus=native_fmus.parent)


@pytest.mark.parametrize("path", sorted((HERE / "invalid").iterdir()), ids=lambda p: p.stem)
def test_each_fault_is_named_with_its_place(path: Path, native_fmus: Path) -> None:
    """File, line, key, and the nearest names where there are any."""
    line, words = SAYS[path.stem]
    with pytest.raises(InputError) as refused:
        planned(str(path), native_fmus)
    text = refused.value.text()
    assert words in text
    if line is not None:
        assert text.startswith(f"{path}:{line}: ")


def test_every_kind_of_axis_and_metric_at_once(native_fmus: Path) -> None:
    """2 x 2 x 2 cells, 4 drawn points, 2 seeds; the scenario of a run is what the axes say."""
    plan = planned(str(HERE / "valid" / "everything.toml"), native_fmus)
    assert plan.count == 2 * 2 * 2 * 4 * 2
    first, last = (plan.runner.variations.scenario(plan.runner.points[i]) for i in (0, 63))
    assert (first.links["uplink"].delay, last.links["downlink"].delay) == (0.05, 0.2)
    assert first.design is not None
    assert last.design is not None
    assert (first.design.loop_delay, last.design.loop_delay) == (1.25, 1.0)
    assert (first.run.seed, last.run.seed) == (1, 2)
    losses = [getattr(last.links[name], "loss", 0.0) for name in ("uplink", "downlink")]
    assert losses[0] == 2 * losses[1]


@pytest.mark.parametrize("name", builtin_studies())
def test_built_in_studies_can_be_planned(name: str, native_fmus: Path) -> None:
    """And have a title that says what they ask."""
    plan = planned(name, native_fmus)
    assert plan.count > 1
    assert plan.job.study.title


def test_the_same_study_in_python_and_in_toml_has_the_same_hash(native_fmus: Path) -> None:
    """And goes through JSON without loss."""
    loaded = load_study("delay-margin")
    study = loaded.study
    again = Study.model_validate_json(study.model_dump_json(exclude_unset=True))
    assert again == study
    written = Study(
        title="Another title",
        scenario=study.scenario,
        vary=[
            {
                "kind": "grid",
                "name": "delay",
                "linspace": [0.02, 0.5, 25],
                "apply": {"links.uplink.delay": "x - 1.5 * 0.005"},
            }
        ],
        metrics=study.metrics,
    )
    plans = [plan_of(one, loaded.base, fmus=native_fmus.parent) for one in (written, study)]
    assert plans[0].job.digest == plans[1].job.digest


def test_a_study_that_does_not_exist_names_those_that_do() -> None:
    """By name, and by path."""
    with pytest.raises(InputError, match="did you mean delay-margin"):
        load_study("delay-marign")
    with pytest.raises(InputError, match="cannot be read"):
        load_study("nowhere.toml")


def test_a_gain_that_the_design_sets_cannot_be_varied(native_fmus: Path) -> None:
    """K of the controller flies as it was designed: the study says where to vary it."""
    study = Study(
        title="t",
        scenario="paper-example",
        vary=[{"kind": "grid", "path": "components.controller.parameters.K[1,1]", "values": [1.0]}],
        metrics={"x": "final.plant.x[1]"},
    )
    with pytest.raises(InputError, match="is set by the design of the scenario") as refused:
        plan_of(study, load("paper-example"), fmus=native_fmus.parent)
    assert "design.gain" in refused.value.text()


def test_the_study_that_the_documentation_shows_can_be_planned(
    native_fmus: Path, tmp_path: Path
) -> None:
    """6 delays, 128 points, 4 seeds."""
    page = (HERE.parents[1] / "docs" / "how-to" / "studies.md").read_text("utf-8")
    (tmp_path / "shown.toml").write_text(page.split("```toml\n")[1].split("```")[0])
    assert planned(str(tmp_path / "shown.toml"), native_fmus).count == 6 * 128 * 4
