"""A sensor takes its values when it should, stamps them, and adds noise of the stated law."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from raw_fmu import RawFmu
from scipy import stats
from test_native_agrees import STEPS, differing

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, component_module
from cosim.network import draws, single_log, single_uniform, standard_normal

VARIABLES = component_module("sensor.variables")
BEHAVIOUR = component_module("sensor.behaviour")


def sensor(count: int = 1, start: float = 0.0, **values: float) -> tuple[Any, dict[str, Any]]:
    """The behaviour of a sensor and its variables; keywords are parameters, noise for noise[1]."""
    spec = VARIABLES.sensor_spec("S", [("value", "m")] * count)
    v: dict[str, Any] = {x.name: x.start for x in spec.variables}
    v.update({f"{k}[1]" if k in ("noise", "bias") else k: x for k, x in values.items()})
    behaviour = BEHAVIOUR.Sensor(dict(spec.constants))
    behaviour.initialise(v, start)
    return behaviour, v


def test_values_are_taken_at_their_instants_and_stamped() -> None:
    """Offset 0.1, period 0.2, steps of 0.05: the value of an instant comes out one step later."""
    behaviour, v = sensor(sample_time=0.2, offset=0.1, bias=0.25)
    assert (v["y[1]"], v["stamp"]) == (0.0, -1.0)
    seen = []
    for k in range(12):
        v["u[1]"] = float(k)
        behaviour.advance(v, 0.05 * (k + 1))
        seen.append((v["y[1]"], v["stamp"]))
    # taken at points 2, 6, 10
    wanted = [(0.0, -1.0)] * 2 + [(2.25, 0.1)] * 4 + [(6.25, 0.3)] * 4
    assert seen == wanted + [(10.25, 0.5)] * 2


def test_stamp_is_the_point_whose_values_were_taken() -> None:
    """An instant inside a step, and several in one: what the sensor has is of the step's start."""
    behaviour, v = sensor(sample_time=0.25, start=4.0)
    assert v["stamp"] == 3.0
    for end, stamp in ((4.1, 4.0), (4.3, 4.1), (4.4, 4.1), (6.4, 4.4), (6.5, 4.4), (6.6, 6.5)):
        v["u[1]"] = end
        behaviour.advance(v, end)
        assert v["stamp"] == stamp
    behaviour, v = sensor(sample_time=0.0, offset=0.1)
    stamps = []
    for k in range(4):
        behaviour.advance(v, 0.05 * (k + 1))
        stamps.append(v["stamp"])
    assert stamps == [-1.0, -1.0, 0.1, 0.15]


def test_single_draws_are_the_streams_of_the_links() -> None:
    """Philox, its keys and the logarithm of `draws`, number by number, to the last bit."""
    for seed, name, turn in ((0, "a", 0), (2**31 - 1, "τ", 2)):
        wanted = draws.uniform(seed, name, "noise 1", 41, turn, first=5).tolist()
        found = [single_uniform(seed, name, "noise 1", k, turn) for k in range(5, 46)]
        assert found == wanted
    x = np.concatenate([draws.uniform(1, "x", "y", 200), [1.0, 0.5, math.sqrt(0.5), 5e-324, 1e308]])
    assert [single_log(float(value)) for value in x] == draws.log(x).tolist()


def test_noise_has_the_stated_law() -> None:
    """Standard normal: Kolmogorov-Smirnov, mean, variance, and no correlation with what is near."""
    n = np.array([[standard_normal(3, "S", f"noise {i}", k) for k in range(4000)] for i in (1, 2)])
    assert stats.kstest(n.ravel(), "norm").pvalue > 0.01
    assert abs(n.mean()) < 3 / math.sqrt(n.size)
    assert abs(n.var() - 1.0) < 3 * math.sqrt(2 / n.size)
    for a, b in ((n[0, 1:], n[0, :-1]), (n[0], n[1])):
        assert abs(np.corrcoef(a, b)[0, 1]) < 3 / math.sqrt(4000)


def test_noise_is_scaled_added_to_the_bias_and_of_its_sample() -> None:
    """y = u + bias + noise n_k, whether every sample is stepped to or some are jumped over."""
    behaviour, v = sensor(2, sample_time=0.1, noise=2.0, bias=-1.0)
    v["seed"], v["u[1]"], v["u[2]"] = 9, 0.5, 3.0
    for end, k in ((0.1, 0), (0.2, 1), (0.3, 2), (0.85, 8), (0.9, 8), (1.0, 9)):
        behaviour.advance(v, end)
        assert v["y[1]"] == 0.5 - 1.0 + 2.0 * standard_normal(9, "S", "noise 1", k)
        assert v["y[2]"] == 3.0


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("period", [0.07, 0.0])
def test_c_and_python_agree_to_the_last_bit(native_fmus: Path, steps: str, period: float) -> None:
    """Sampled at a period of its own, and at every point."""
    reals = {"sample_time": period, "offset": 0.02, "bias[3]": 0.1, "noise[2]": 0.0}
    path, spec = native_fmus / "Sensor.fmu", CATALOGUE["Sensor"]
    assert differing(path, spec, STEPS[steps], reals, {"seed": 77}) == []


@pytest.mark.parametrize("flavour", ["native_fmus", "fmus"])
def test_saved_sensor_goes_on_as_it_would_have(
    request: pytest.FixtureRequest, flavour: str
) -> None:
    """Noise and clock included, in another instance; two runs with a seed are the same."""
    path = request.getfixturevalue(flavour) / "Sensor.fmu"

    def steps(raw: RawFmu, first: int, last: int) -> list[list[float]]:
        rows = []
        for k in range(first, last):
            raw.put({"u[1]": math.sin(k)})
            raw.step(0.3 * k, 0.3)
            rows.append(raw.get("y[1]", "y[4]", "stamp"))
        return rows

    with RawFmu(path) as raw, RawFmu(path, "other", raw) as other:
        raw.initialise()
        steps(raw, 0, 11)
        data = raw.saved()
        once = steps(raw, 11, 30)
        other.resume(data)
        assert steps(other, 11, 30) == once
        assert len({row[2] for row in once}) > 3
        other.fmu.reset()
        other.initialise()
        assert steps(other, 0, 30)[11:] == once


def test_any_number_of_values_is_fixed_when_built(tmp_path: Path) -> None:
    """Names and units of the values, start values of the parameters; one value and the most."""
    spec = VARIABLES.sensor_spec(
        "Dvl", [("surge", "m/s"), ("sway", "knots")], noise=(0.01, 0.02), sample_time=0.2, seed=4
    )
    start = {v.name: v.start for v in spec.variables}
    assert (start["noise[2]"], start["bias[1]"], start["sample_time"]) == (0.02, 0.0, 0.2)
    units = {v.name: v.unit for v in spec.variables}
    assert (units["u[1]"], units["y[2]"], units["stamp"]) == ("m/s", None, "s")
    assert not any(v.depends_on for v in spec.variables)
    with RawFmu(build_fmu(spec, tmp_path, "native")) as raw:
        raw.initialise()
        raw.put({"u[1]": 1.0, "u[2]": 2.0})
        raw.step(0.0, 0.05)
        noise = [standard_normal(4, "Dvl", f"noise {i}", 0) for i in (1, 2)]
        assert raw.get("y[1]", "y[2]") == [1.0 + 0.01 * noise[0], 2.0 + 0.02 * noise[1]]


def test_what_cannot_be_built_or_counted_is_refused(native_fmus: Path) -> None:
    """No values, too many, noise of another length; samples too dense for a double."""
    for values, noise in (([], ()), ([("x", None)] * 65, ()), ([("x", None)], (1.0, 2.0))):
        with pytest.raises(ValueError, match="S: "):
            VARIABLES.sensor_spec("S", values, noise=noise)
    behaviour, v = sensor(sample_time=1e-300)
    with pytest.raises(ArithmeticError, match="cannot be counted"):
        behaviour.advance(v, 1.0)
    with RawFmu(native_fmus / "Sensor.fmu") as raw:
        raw.initialise({"sample_time": 1e-300})
        with pytest.raises(Exception, match="discard"):
            raw.step(0.0, 1.0)
        assert "cannot be counted" in raw.messages
