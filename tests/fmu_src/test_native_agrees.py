"""The native FMU against the Python equations, bit for bit, and against true solutions."""

from __future__ import annotations

import math
import random
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import two_delays
from driven import behaviour_of, drive, started
from raw_fmu import RawFmu
from shared import sampled
from truth.dde import Hold, solve

from cosim.fmu import build_fmu
from cosim.fmu.export import CATALOGUE, ComponentSpec

NAMES = sorted(CATALOGUE)


def uneven(count: int, longest: float) -> list[float]:
    """Draw communication steps of every size."""
    generator = random.Random(7)  # noqa: S311 - no secret
    return [generator.uniform(1e-4, longest) for _ in range(count)]


STEPS = {"even": [0.05] * 60, "odd": [1 / math.pi] * 20, "uneven": uneven(60, 0.9)}
DELAYS = (0.0, 0.5, 0.3, 1 / math.sqrt(7), 0.01)


def moving(port: str, k: int) -> float:
    """Give an input that jumps at most points, stays at some, and is a negative zero once."""
    if k == 3:
        return -0.0
    return 0.0 if k % 7 == 0 else 2.0 * math.sin(0.7 * (k // 2) + len(port))


def differing(
    path: Path,
    spec: ComponentSpec,
    sizes: list[float],
    reals: dict[str, float],
    integers: dict[str, int] | None = None,
) -> list[Any]:
    """Run both, the same calls; give (step, name, python, native) where a bit differs."""
    behaviour = behaviour_of(spec)
    v: dict[str, Any] = {
        x.name: x.start if x.kind == "Real" else int(x.start) for x in spec.variables
    }
    v.update(reals)
    v.update(integers or {})
    behaviour.initialise(v, 0.0)
    ports = [x.name for x in spec.variables if x.causality == "input"]
    found, t = [], 0.0
    with RawFmu(path) as raw:
        for name, value in (integers or {}).items():
            raw.fmu.setInteger([raw.reference[name]], [value])
        raw.initialise(reals)
        outputs = raw.outputs()
        for k, h in enumerate(sizes):
            values = {port: moving(port, k) for port in ports}
            v.update(values)
            raw.put(values)
            behaviour.advance(v, t + h)
            raw.step(t, h)
            t += h
            got = raw.get(*outputs)
            found += [
                (k, name, v[name], value)
                for name, value in zip(outputs, got, strict=True)
                if value.hex() != float(v[name]).hex()
            ]
        assert raw.messages == ""
    assert any(v[name] != 0.0 for name in outputs)
    return found


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("d", sampled(DELAYS, 2))
@pytest.mark.parametrize("name", ["AuvPlant", "DelayedPlant"])
def test_plants_agree_to_the_last_bit(native_fmus: Path, name: str, d: float, steps: str) -> None:
    """Delays commensurate with the steps or not, shorter or longer, none at all."""
    extra = {"initial.nu.r": 0.05, "damping.u": 0.4} if name == "AuvPlant" else {"F.omega": 2.0}
    own = {"delay.d": d, **extra}
    assert differing(native_fmus / f"{name}.fmu", CATALOGUE[name], STEPS[steps], own) == []


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("name", ["HinfController", "PaperController"])
def test_controllers_agree_to_the_last_bit(native_fmus: Path, name: str, steps: str) -> None:
    """Sampled at a period of their own, limited and mapped to forces."""
    own = {"sample_time": 0.07}
    assert differing(native_fmus / f"{name}.fmu", CATALOGUE[name], STEPS[steps], own) == []


@pytest.mark.parametrize("count", [1, 2, 3, 20, 200])
@pytest.mark.parametrize("spectrum", [0, 1, 2])
def test_sea_agrees_to_the_last_bit(native_fmus: Path, spectrum: int, count: int) -> None:
    """Every spectrum, from one harmonic to the most there may be."""
    reals = {"Hs": 2.5, "Tp": 7.0, "amplitude[1]": 0.4, "amplitude[3]": 0.2, "omega[3]": 2.2}
    integers = {"spectrum": spectrum, "components": count, "seed": 1000 + count}
    path = native_fmus / "WaveField.fmu"
    assert differing(path, CATALOGUE["WaveField"], STEPS["odd"], reals, integers) == []


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a component with two delays that the catalogue does not have."""
    return build_fmu(two_delays.SPEC, tmp_path_factory.mktemp("two"), prebuilt=False)


@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize("delays", [(0.3, 0.47), (0.3, 0.3), (0.0, 0.41), (0.02, 1.9), (0.0, 0.0)])
def test_two_delays_agree_to_the_last_bit(
    two: Path, delays: tuple[float, float], steps: str
) -> None:
    """Images through sums of two delays, equal delays, one of zero."""
    own = dict(zip(("delay.first", "delay.second"), delays, strict=True))
    assert differing(two, two_delays.SPEC, STEPS[steps], own) == []


@pytest.mark.parametrize("steps", STEPS)
def test_plain_equation_agrees_and_is_the_solution(tmp_path: Path, steps: str) -> None:
    """Neither delays nor inputs: x' = cos t - x, whose solution is known."""
    path = build_fmu(two_delays.NO_DELAY, tmp_path, prebuilt=False)
    own = {"solver.step": 0.01}
    assert differing(path, two_delays.NO_DELAY, STEPS[steps], own) == []
    with RawFmu(path) as raw:
        raw.initialise(own)
        raw.step(0.0, 2.0)
        data = raw.saved()
        exact = (math.cos(2.0) + math.sin(2.0)) / 2
        assert raw.get("x") == pytest.approx([exact], abs=1e-9)
        raw.resume(data)
        assert raw.saved() == data


@pytest.mark.parametrize("name", NAMES)
def test_both_flavours_give_the_same_bits(fmus: Path, native_fmus: Path, name: str) -> None:
    """The two FMUs themselves, loaded by fmpy, driven alike."""
    with started(fmus, name) as python, started(native_fmus, name) as native:
        expected = drive(python, name, 0, 60)
        assert drive(native, name, 0, 60) == expected
        assert native.messages == ""


SQRT7, PI = 1 / math.sqrt(7), 1 / math.pi
ORDERS = [
    ((0.0, 0.0), 0.25),
    ((0.5, 0.0), 0.25),
    ((0.1, 0.0), 0.25),
    ((SQRT7, 0.0), 0.25),
    ((0.3, 0.0), PI),
    ((0.3, 0.47), 0.25),
    ((0.3, 0.47), PI),
    ((0.3, 0.47), 0.6),
]


@pytest.mark.parametrize(("delays", "period"), ORDERS)
def test_halving_the_internal_step_divides_the_error_by_16(
    two: Path, delays: tuple[float, float], period: float
) -> None:
    """Whatever the delays and the communication step, held inputs that jump included."""
    count = math.ceil(3.0 / period - 1e-9)
    times = [k * period for k in range(count)]
    u = Hold(times, [np.array([math.cos(2.1 * t), math.sin(1.3 * t)]) for t in times])
    equation = two_delays.TwoDelays({})

    def rate(t: float, x: np.ndarray, late: list[np.ndarray]) -> Any:
        return equation.rates(t, x, late, u(t), 1.0, math)

    exact = solve(rate, [1.0, -0.5], list(delays), count * period, switches=times)
    errors = []
    for step in (0.1, 0.05, 0.025, 0.0125):
        own = {"delay.first": delays[0], "delay.second": delays[1], "solver.step": step}
        rows = []
        with RawFmu(two) as raw:
            raw.initialise(own)
            for t in times:
                raw.put(dict(zip(("push[1]", "push[2]"), map(float, u(t)), strict=True)))
                raw.step(t, period)
                rows.append(raw.get("x[1]", "x[2]") - exact(t + period))
        errors.append(float(np.linalg.norm(rows)))
    ratios = [a / b for a, b in pairwise(errors)]
    print(  # noqa: T201 - the table is what the test shows
        f"delays {delays[0]:.4f} {delays[1]:.4f} s, communication step {period:.4f} s: "
        f"errors {' '.join(f'{e:.2e}' for e in errors)}, ratios "
        f"{' '.join(f'{r:.1f}' for r in ratios)}"
    )
    assert all(13.0 < ratio < 20.0 for ratio in ratios), (errors, ratios)
