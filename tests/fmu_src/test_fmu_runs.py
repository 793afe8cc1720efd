"""The python FMUs in plain fmpy: true solutions, any step, many instances, saved states."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from driven import DRIVE, drive, started
from fmpy import simulate_fmu
from raw_fmu import RawFmu, matrices
from shared import slow_share_of
from truth.dde import Hold, solve

from cosim.fmu.export import CATALOGUE
from cosim.models import TABLE_1

NAMES = sorted(CATALOGUE)

SIMPLEST = {
    **matrices(A=np.zeros((2, 2)), A1=[[-1, 0], [0, 0]], E=np.zeros((2, 2))),
    "delay.d": 1.0,
    "F.amplitude": 0.0,
    "initial.x[1]": 1.0,
    "initial.x[2]": 0.0,
}
"""DelayedPlant as x' = -x(t-1), history 1."""


@pytest.mark.parametrize("h", [1.0, 0.25, 0.1])
def test_simplest_delay_equation_at_its_known_values(fmus: Path, h: float) -> None:
    """X' = -x(t-1), history 1, through DelayedPlant: 0, -1/2, -1/6, 19/120 at 1, 2, 3, 5."""
    with RawFmu(fmus / "DelayedPlant.fmu") as raw:
        raw.initialise(SIMPLEST)
        seen = {}
        for k in range(round(5 / h)):
            raw.step(k * h, h)
            seen[round((k + 1) * h, 9)] = raw.get("x[1]")[0]
        got = [seen[t] for t in (1.0, 2.0, 3.0, 5.0)]
    assert got == pytest.approx([0.0, -1 / 2, -1 / 6, 19 / 120], rel=0, abs=5e-10)


@pytest.mark.parametrize("name", NAMES)
def test_every_fmu_runs_in_simulate_fmu(fmus: Path, name: str) -> None:
    """fmpy's own master runs each from its defaults to its default end."""
    result = simulate_fmu(str(fmus / f"{name}.fmu"), stop_time=1.0)
    assert result["time"][-1] == pytest.approx(1.0)
    assert all(np.isfinite(result[column]).all() for column in result.dtype.names)


@pytest.mark.parametrize("name", NAMES)
def test_declared_starts_are_the_initial_outputs(fmus: Path, name: str) -> None:
    """What the model description says of an output is what it is after initialisation."""
    with RawFmu(fmus / f"{name}.fmu") as raw:
        declared = [float(v.start) for v in raw.model.modelVariables if v.causality == "output"]
        raw.initialise()
        assert raw.get(*raw.outputs()) == pytest.approx(declared, rel=0, abs=1e-15)


@pytest.mark.parametrize("h", [0.5, 0.125, 0.07])
def test_vehicle_with_zero_order_hold_forces_against_the_reference(fmus: Path, h: float) -> None:
    """AuvPlant under stepwise forces and accelerations is the delay equation's solution."""
    end = 2.8
    count = round(end / h + 0.499)
    times = [k * h for k in range(count)]
    force = np.array([[300 * math.cos(t), 200 * math.sin(2 * t), -150.0, 80 * t] for t in times])
    wind = np.array([[0.02 * math.sin(t), -0.01, 0.03 * math.cos(t), 0.01] for t in times])
    start = {"eta.psi": 0.4, "nu.u": 0.5, "nu.v": -0.2, "nu.w": 0.1, "nu.r": 0.1, "eta.x": 1.0}
    parameters = {f"initial.{key}": value for key, value in start.items()} | {
        "delay.d": 0.3,
        "damping.u": 0.4,
        "damping.r": 0.3,
        "solver.step": 0.01,
    }
    with RawFmu(fmus / "AuvPlant.fmu") as raw:
        raw.initialise(parameters)
        names = raw.outputs()
        for k, t in enumerate(times):
            raw.put(dict(zip(("force.x", "force.y", "force.z", "moment.z"), force[k], strict=True)))
            raw.put({f"disturbance.{a}": wind[k][i] for i, a in enumerate("uvwr")})
            raw.step(t, h)
        got = raw.get(*names)
    damping = np.array([0.4, 0.05, 0.05, 0.3])
    tau, w = Hold(times, list(force)), Hold(times, list(wind))

    def rate(t: float, x: np.ndarray, late: list[np.ndarray]) -> np.ndarray:
        """Eqs. (2) and (3), solved by numpy for the accelerations."""
        turn = complex(x[4], x[5]) * complex(math.cos(x[3]), math.sin(x[3]))
        nu = np.linalg.solve(MASS, quadratic(x[4:]) + tau(t)) - damping * late[0][4:] + w(t)
        return np.array([turn.real, turn.imag, x[6], x[7], *nu])

    initial = [start.get(name, 0.0) for name in names]
    exact = solve(rate, initial, [0.3], count * h, switches=times)
    assert got == pytest.approx(exact(count * h), rel=0, abs=2e-9)


RHO, L, M, IZ = 500.0, 5.3, 5454.0, 13587.0  # density as it enters: half of it
P = {key.removeprefix("hydro."): value for key, value in TABLE_1.items()}
MASS = np.array(
    [
        [M - RHO * L**3 * P["X_udot"], 0, 0, 0],
        [0, M - RHO * L**3 * P["Y_vdot"], 0, -RHO * L**4 * P["Y_rdot"]],
        [0, 0, M - RHO * L**3 * P["Z_wdot"], 0],
        [0, -RHO * L**4 * P["N_vdot"], 0, IZ - RHO * L**5 * P["N_rdot"]],
    ]
)
QUADRATIC = {
    "X": {"vv": 2, "ww": 2, "rr": 4, "vr": 3},
    "Y": {"ur": 3, "wr": 3, "uv": 2, "vw": 2},
    "Z": {"rr": 4, "vr": 3, "uw": 2, "vv": 2},
    "N": {"ur": 4, "wr": 4, "uv": 3, "vw": 3},
}
"""Powers of L with the derivatives of Eq. (3)."""


def quadratic(nu: np.ndarray) -> np.ndarray:
    """Give the right-hand side of Eq. (3) without thrust, Coriolis terms of the mass included."""
    speed = dict(zip("uvwr", nu, strict=True))
    force = np.array(
        [
            sum(RHO * L**n * P[f"{row}_{ab}"] * speed[ab[0]] * speed[ab[1]] for ab, n in q.items())
            for row, q in QUADRATIC.items()
        ]
    )
    return force + M * np.array([nu[1] * nu[3], -nu[0] * nu[3], 0.0, 0.0])


def test_result_does_not_depend_on_how_the_steps_vary(fmus: Path) -> None:
    """Without inputs, steps of any size end at the same state to the integrator's error."""
    generator = np.random.default_rng(1)
    ends = []
    for cuts in ([], np.linspace(0, 2, 41)[1:-1], np.sort(generator.uniform(0, 2, 30))):
        points = [0.0, *cuts, 2.0]
        with RawFmu(fmus / "DelayedPlant.fmu") as raw:
            raw.initialise({"solver.step": 0.005})
            for a, b in pairwise(points):
                raw.step(a, b - a)
            ends.append(raw.get("x[1]", "x[2]"))
            assert raw.messages == ""
    assert ends[1] == pytest.approx(ends[0], abs=2e-8)
    assert ends[2] == pytest.approx(ends[0], abs=2e-8)


def test_waves_do_not_depend_on_the_step(fmus: Path) -> None:
    """The sea is a closed form: one long step or many, the same bits."""
    ends = []
    for n in (1, 7, 64):
        with RawFmu(fmus / "WaveField.fmu") as raw:
            raw.initialise()
            for k in range(n):
                raw.step(k * 4.0 / n, 4.0 / n)
            ends.append(raw.get(*raw.outputs()))
    assert ends[1] == pytest.approx(ends[0], rel=1e-13)
    assert ends[2] == ends[0]


def test_explicit_wave_is_the_sine(fmus: Path) -> None:
    """One component (1, 1, 0) with gain 1 on u is sin t: the disturbance of section 5."""
    with RawFmu(fmus / "WaveField.fmu") as raw:
        raw.fmu.setInteger([raw.reference["spectrum"]], [0])
        raw.initialise({"amplitude[1]": 1.0, "gain.v": 0.0, "gain.w": 0.0, "gain.r": 0.0})
        for k in range(20):
            raw.step(0.3 * k, 0.3)
            assert raw.get(*raw.outputs()) == pytest.approx([math.sin(0.3 * k + 0.3), 0, 0, 0])


def test_z_has_direct_feedthrough(fmus: Path) -> None:
    """DelayedPlant's z = D x + D1 w + D2 u with the present inputs and the x of the last step."""
    with RawFmu(fmus / "DelayedPlant.fmu") as raw:
        raw.initialise()
        raw.step(0.0, 0.1)
        x = np.array(raw.get("x[1]", "x[2]"))
        raw.put({"u[1]": 2.0, "w[1]": -3.0})
        z = -x + np.array([4, 3]) * -3.0 + np.array([3, -1]) * 2.0
        assert raw.get("z[1]", "z[2]") == pytest.approx(z, abs=1e-13)
        assert raw.get("x[1]", "x[2]") == x.tolist()


def test_initialisation_mode_follows_parameters(fmus: Path) -> None:
    """Between enter and exit, outputs are those of the parameters set so far."""
    with RawFmu(fmus / "AuvPlant.fmu") as raw:
        raw.fmu.setupExperiment(startTime=0.0)
        raw.fmu.enterInitializationMode()
        for value in (2.0, 3.0):
            raw.put({"initial.eta.z": value})
            assert raw.get("eta.z") == [value]
        raw.fmu.exitInitializationMode()
        assert raw.get("eta.z") == [3.0]


def test_run_may_start_at_any_time(fmus: Path) -> None:
    """A run from t = 100 sees F(t) and the waves of t = 100, and steps from there."""
    with RawFmu(fmus / "WaveField.fmu") as raw, RawFmu(fmus / "WaveField.fmu") as other:
        raw.initialise(start=100.0)
        other.initialise()
        other.step(0.0, 100.0)
        assert raw.get(*raw.outputs()) == other.get(*other.outputs())


@pytest.mark.parametrize("name", NAMES)
def test_saved_state_goes_on_bit_for_bit(fmus: Path, name: str) -> None:
    """Back in the same instance, and over to a fresh one: the same bits, delay line included."""
    with started(fmus, name) as raw, RawFmu(fmus / f"{name}.fmu", "fresh") as fresh:
        drive(raw, name, 0, 17)
        data = raw.saved()
        state = raw.fmu.getFMUstate()
        outputs = raw.get(*raw.outputs())
        onward = drive(raw, name, 17, 40)
        assert onward[-1] != outputs
        raw.fmu.setFMUstate(state)
        assert raw.get(*raw.outputs()) == outputs
        assert drive(raw, name, 17, 40) == onward
        fresh.resume(data)
        assert fresh.get(*fresh.outputs()) == outputs
        assert drive(fresh, name, 17, 40) == onward
        assert fresh.saved() == raw.saved()
        raw.fmu.setFMUstate(state)
        assert drive(raw, name, 17, 40) == onward
        assert raw.messages == fresh.messages == ""


def test_serialized_state_holds_the_delay_line(fmus: Path) -> None:
    """The bytes are JSON, with the history of one delay and no secrets of the process."""
    with started(fmus, "DelayedPlant") as raw:
        drive(raw, "DelayedPlant", 0, 10)
        line = json.loads(raw.saved())["behaviour"]["line"]
        assert line["pieces"][0][0] <= 0.5 - 0.23
        assert line["pieces"][-1][1] == pytest.approx(0.5)


@pytest.mark.parametrize("name", NAMES)
def test_reset_starts_anew(fmus: Path, name: str) -> None:
    """After reset the parameters are the defaults and a run is that of a new instance."""
    with started(fmus, name) as raw, RawFmu(fmus / f"{name}.fmu") as fresh:
        drive(raw, name, 0, 7)
        raw.fmu.reset()
        raw.initialise()
        fresh.initialise()
        assert drive(raw, name, 0, 9) == drive(fresh, name, 0, 9)
        raw.fmu.terminate()
        raw.fmu.reset()
        raw.initialise(dict(DRIVE[name][2]))
        with started(fmus, name) as other:
            assert drive(raw, name, 0, 9) == drive(other, name, 0, 9)


def test_instances_do_not_disturb_each_other(fmus: Path) -> None:
    """Three instances of each FMU, stepped in turn, give what each gives alone."""
    alone = {}
    for name in NAMES:
        with started(fmus, name) as raw:
            alone[name] = drive(raw, name, 0, 12)
    with ExitStack() as stack:
        crowd = [
            (name, stack.enter_context(started(fmus, name, f"{name}{i}")))
            for i in range(3)
            for name in NAMES
        ]
        for k in range(12):
            for name, raw in crowd:
                assert drive(raw, name, k, k + 1) == [alone[name][k]], (name, k)


def test_modules_are_unique_per_fmu(fmus: Path) -> None:
    """FMUs share one table of modules; what each imports carries its name and hash."""
    with ExitStack() as stack:
        for name in NAMES:
            stack.enter_context(started(fmus, name))
        mine = {m: str(v.__file__) for m, v in sys.modules.items() if "_parts" in m}
        for name in NAMES:
            tag = RawFmu.tag(fmus / f"{name}.fmu")
            parts = [m for m in mine if m.startswith(f"{name}_{tag}_parts")]
            assert {f"{name}_{tag}_parts.table"} <= set(parts)
            assert len(parts) >= 4


CYCLES = """
import resource, sys
from pathlib import Path
from raw_fmu import RawFmu
folder, name, count = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
values = []
for k in range(count):
    with RawFmu(folder / f"{name}.fmu") as raw:
        raw.initialise()
        raw.step(0.0, 0.1)
        values.append(raw.get(*raw.outputs()))
        raw.fmu.terminate()
    if k == count // 2:
        half = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
assert all(v == values[0] for v in values)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - half)
"""


def in_a_process(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    here = Path(__file__).resolve().parent
    return subprocess.run(  # noqa: S603 - our own script
        [sys.executable, "-c", script, *arguments],
        check=False,
        capture_output=True,
        text=True,
        env={"PYTHONPATH": str(here), "PYTHONFAULTHANDLER": "1"},
    )


@pytest.mark.parametrize("name", slow_share_of(["AuvPlant", "WaveField"]))
def test_two_hundred_lives_in_one_process(fmus: Path, name: str) -> None:
    """200 instances, one after the other: the same values, no crash, memory that stays."""
    done = in_a_process(CYCLES, str(fmus), name, "200")
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) < 20_000  # KiB over the second hundred
