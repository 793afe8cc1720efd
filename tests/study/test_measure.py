"""Figures of runs, compared with closed forms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from study.deadly import base, planned, study

from cosim.core import InputError
from cosim.scenario import load
from cosim.study import Study, execute_study, plan_of, read_table

LONG = {"run.end": 20.0, "run.step": 0.005}


def taken(
    out: Path, signals: Mapping[str, str], more: str = "", **given: Any
) -> list[dict[str, Any]]:
    """The rows of a study about signals of time: by name `p.NAME`, each an expression."""
    lines = "".join(f'{name} = "{text}"\n' for name, text in signals.items())
    of = base(more=f"[computed.p]\n{lines}{more}")
    asked = {"set": LONG, **given}
    execute_study(planned(study(asked.pop("u", [0.0]), **asked), of), out)
    rows: list[dict[str, Any]] = read_table(out)[0].to_pylist()
    return rows


def test_reductions_of_a_sinusoid(tmp_path: Path) -> None:
    """2 sin t + 1 over whole periods: rms about 1 is sqrt 2, mean is 1, extremes 3 and -1."""
    reduced: dict[str, dict[str, Any]] = {
        "rms": {"reduce": "rms", "to": 1.0},
        "mean": {"reduce": "mean"},
        "maximum": {"reduce": "maximum"},
        "minimum": {"reduce": "minimum"},
        "max_abs": {"reduce": "max_abs", "to": 2.0},
        "final": {"reduce": "final"},
    }
    metrics = {name: {"signal": "p.x", **how} for name, how in reduced.items()}
    (found,) = taken(tmp_path, {"x": "1 + 2 * sin(pi * t)"}, metrics=metrics)
    assert found["rms"] == pytest.approx(math.sqrt(2.0), rel=1e-5)
    assert found["mean"] == pytest.approx(1.0, abs=1e-9)
    assert found["maximum"] == pytest.approx(3.0, abs=1e-4)
    assert found["minimum"] == pytest.approx(-1.0, abs=1e-4)
    assert found["max_abs"] == pytest.approx(3.0, abs=1e-4)
    assert found["final"] == pytest.approx(1.0, abs=1e-9)


def test_the_mean_does_not_depend_on_where_the_points_lie(tmp_path: Path) -> None:
    """Twice as dense in one half, by events between the steps: the integral counts."""
    events = "".join(
        f'[[events]]\nat = {0.1 * i + 0.05:.2f}\nset = {{ "tiny.u" = 0.0 }}\n' for i in range(10)
    )
    metrics = {"mean": {"signal": "p.x", "reduce": "mean"}}
    (found,) = taken(
        tmp_path, {"x": "t"}, events, metrics=metrics, set={"run.end": 2.0, "run.step": 0.1}
    )
    assert found["mean"] == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("rate", [-0.7, 0.2])
def test_the_growth_rate_of_an_exponential_is_its_exponent(rate: float, tmp_path: Path) -> None:
    """Also of a spiral, by its norm."""
    grows = f"exp({rate} * t)"
    signals = {"x": grows, "a": f"{grows} * cos(3 * t)", "b": f"{grows} * sin(3 * t)"}
    metrics = {
        "alone": {"signal": "p.x", "reduce": "growth_rate"},
        "spiral": {"signal": ["p.a", "p.b"], "reduce": "growth_rate", "after": 5.0},
    }
    (found,) = taken(tmp_path, signals, metrics=metrics)
    assert found["alone"] == pytest.approx(rate, rel=1e-4)
    assert found["spiral"] == pytest.approx(rate, rel=1e-4)


def test_settling_time_is_when_the_band_is_left_for_the_last_time(tmp_path: Path) -> None:
    """exp(-t) stays within 0.1 from ln 10 on; what never settles, or ends early, has no time."""
    settled = {"reduce": "settling_time", "within": 0.1}
    metrics = {
        "decays": {"signal": "p.x", **settled},
        "later": {"signal": "p.x", "after": 1.0, **settled},
        "never": {"signal": "p.y", **settled},
        "always": {"signal": "p.z", **settled},
    }
    signals = {"x": "exp(-t / 1 s)", "y": "sin(t / 1 s)", "z": "0 * t"}
    whole, early = taken(
        tmp_path, signals, metrics=metrics, u=[0.0, 100.0], set={**LONG, "run.divergence": 99.0}
    )
    assert whole["decays"] == pytest.approx(math.log(10.0), abs=0.006)
    assert whole["later"] == pytest.approx(math.log(10.0) - 1.0, abs=0.006)
    assert (whole["never"], whole["always"]) == (None, 0.0)
    assert early["status"] == "diverged"
    assert (early["decays"], early["always"]) == (None, None)


def test_bounds_give_true_or_false_and_a_missing_value_gives_false(tmp_path: Path) -> None:
    """below and above are strict; what does not exist is not."""
    final = {"signal": "p.x", "reduce": "final"}
    metrics = {
        "at": {**final, "below": 20.0},
        "between": {**final, "below": 20.1, "above": 19.9},
        "none": {**final, "after": 30.0},
        "none_below": {**final, "after": 30.0, "below": 1.0},
        "is": {"path": "status", "equals": "finished"},
    }
    (found,) = taken(tmp_path / "a", {"x": "t"}, metrics=metrics)
    assert [found[name] for name in metrics] == [False, True, None, False, True]
    words = {"m": {"path": "status", "below": 1.0}}
    with pytest.raises(InputError, match="below and above need a number"):
        taken(tmp_path / "b", {"x": "t"}, metrics=words)


def test_a_table_as_metric_is_refused(tmp_path: Path) -> None:
    """What is in it is said."""
    with pytest.raises(InputError, match="single value") as refused:
        taken(tmp_path, {"x": "t"}, metrics={"m": "final"})
    assert "p.x" in refused.value.text()


def test_the_zero_state_run_is_made_only_for_metrics_that_need_it(
    native_fmus: Path,
) -> None:
    """The gain is; the age of the measurements is not: then a run has no gain."""

    def gain(metrics: dict[str, Any]) -> Any:
        asked = Study(
            title="t",
            scenario="auv-acoustic",
            set={"run.end": 1.0, "components.plant.parameters.initial.eta.x": 1.0},
            vary=[{"kind": "replicates", "count": 1}],
            metrics=metrics,
        )
        made = plan_of(asked, load("auv-acoustic"), fmus=native_fmus.parent)
        return made.runner.execute_run(0)[0].to_json()["metrics"]["gain"]

    figures = {"age": "metrics.message_age_s", "x": {"signal": "plant.eta.x", "reduce": "rms"}}
    assert gain({"g": "metrics.gain"}) is not None
    assert gain(figures) is None
    assert gain({"e": "metrics.envelope_use.u"}) is not None
