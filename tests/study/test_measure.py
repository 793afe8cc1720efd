"""Figures of runs, compared with closed forms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master import Run
from cosim.study import Metric
from cosim.study.measurement import measure, needs_zero_state_run

T = np.linspace(0.0, 20.0, 4001)


@dataclass
class Recorded:
    """What a metric looks at in a run."""

    signals: dict[str, NDArray[np.float64]]
    t: NDArray[np.float64] = field(default_factory=lambda: T)
    status: str = "finished"

    @property
    def points_ns(self) -> Any:
        """The points."""
        return np.round(self.t * 1e9).astype(np.int64)

    def signal(self, component: str, variable: str) -> NDArray[np.float64]:
        """A signal by name."""
        return self.signals[f"{component}.{variable}"]


def taken(signals: dict[str, Any], status: str = "finished", **metric: Any) -> Any:
    """A metric of signals."""
    names = list(signals)
    asked = {"signal": names if len(names) > 1 else names[0], **metric}
    return measure(Metric(**asked), {}, cast("Run", Recorded(signals, status=status)))


def test_reductions_of_a_sinusoid() -> None:
    """2 sin t + 1 over whole periods: rms about 1 is sqrt 2, mean is 1, extremes 3 and -1."""
    wave = {"p.x": 1.0 + 2.0 * np.sin(np.pi * T)}
    assert taken(wave, reduce="rms", to=1.0) == pytest.approx(np.sqrt(2.0), rel=1e-5)
    assert taken(wave, reduce="mean") == pytest.approx(1.0, abs=1e-9)
    assert taken(wave, reduce="maximum") == pytest.approx(3.0, abs=1e-4)
    assert taken(wave, reduce="minimum") == pytest.approx(-1.0, abs=1e-4)
    assert taken(wave, reduce="max_abs", to=2.0) == pytest.approx(3.0, abs=1e-4)
    assert taken(wave, reduce="final") == pytest.approx(1.0, abs=1e-9)


def test_the_mean_does_not_depend_on_where_the_points_lie() -> None:
    """Points twice as dense in one half: the integral counts, not the points."""
    t = np.concatenate([np.linspace(0, 1, 101), np.linspace(1, 2, 11)[1:]])
    run = Recorded({"p.x": t}, t=t)
    metric = Metric(signal="p.x", reduce="mean")
    assert measure(metric, {}, cast("Run", run)) == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("rate", [-0.7, 0.2])
def test_the_growth_rate_of_an_exponential_is_its_exponent(rate: float) -> None:
    """Also of a spiral, by its norm."""
    grows = np.exp(rate * T)
    assert taken({"p.x": grows}, reduce="growth_rate") == pytest.approx(rate, rel=1e-4)
    spiral = {"p.x": grows * np.cos(3 * T), "p.y": grows * np.sin(3 * T)}
    assert taken(spiral, reduce="growth_rate", after=5.0) == pytest.approx(rate, rel=1e-4)


def test_settling_time_is_when_the_band_is_left_for_the_last_time() -> None:
    """exp(-t) stays within 0.1 from ln 10 on; what never settles, or ends early, has no time."""
    decays = {"p.x": np.exp(-T)}
    settled = taken(decays, reduce="settling_time", within=0.1)
    assert settled == pytest.approx(np.log(10.0), abs=0.006)
    assert taken(decays, reduce="settling_time", within=0.1, after=1.0) == pytest.approx(
        np.log(10.0) - 1.0, abs=0.006
    )
    assert taken({"p.x": np.sin(T)}, reduce="settling_time", within=0.1) is None
    assert taken(decays, "diverged", reduce="settling_time", within=0.1) is None
    assert taken({"p.x": 0 * T}, reduce="settling_time", within=0.1) == 0.0


def test_bounds_give_true_or_false_and_a_missing_value_gives_false() -> None:
    """below and above are strict; what does not exist is not."""
    x = {"p.x": T}
    assert taken(x, reduce="final", below=20.0) is False
    assert taken(x, reduce="final", below=20.1, above=19.9) is True
    assert taken(x, reduce="final", after=30.0) is None
    assert taken(x, reduce="final", after=30.0, below=1.0) is False
    run = cast("Run", Recorded({}))
    assert measure(Metric(path="status", equals="finished"), {"status": "finished"}, run) is True
    with pytest.raises(InputError, match="below and above need a number"):
        measure(Metric(path="status", below=1.0), {"status": "finished"}, run)


def test_a_table_as_metric_is_refused() -> None:
    """What is in it is said."""
    with pytest.raises(InputError, match="single value") as refused:
        measure(Metric(path="metrics"), {"metrics": {"gain": 1.0}}, cast("Run", Recorded({})))
    assert "gain" in refused.value.text()


def test_the_zero_state_run_is_made_only_for_metrics_that_need_it() -> None:
    """The gain is; the age of the measurements is not."""
    assert needs_zero_state_run({"g": Metric(path="metrics.gain")})
    assert needs_zero_state_run({"e": Metric(path="metrics.envelope_use.u")})
    assert not needs_zero_state_run(
        {"a": Metric(path="metrics.message_age_s"), "x": Metric(signal="p.x", reduce="rms")}
    )
