"""The metrics of a run, recomputed from its trace by other methods."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.shell import shared_run, trace_of
from shared import fmu_store

from cosim.models import STATE, TABLE_1, thrust_map
from cosim.scenario import FmuCache, LoadedScenario, execute_run, load, parse, prepare, problem_of
from cosim.trace import Table, Trace

FORCE = ("force.x", "force.y", "force.z", "moment.z")
WAVES = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")
ACOUSTIC = ("auv-acoustic", "auv-acoustic-naive")


def columns(table: Table, names: tuple[str, ...]) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


def from_rest(name: str, folder: Path) -> LoadedScenario:
    """The scenario with every initial value and the reference at zero, as text."""
    kept = [
        line
        for line in load(name).text.splitlines()
        if not line.startswith(('"initial.', '"eta.', "points ="))
    ]
    at = kept.index('axes = ["x", "y", "z", "psi"]')
    text = "\n".join([*kept[: at + 1], "points = [[0.0, 0.0, 0.0, 0.0, 0.0]]", *kept[at + 1 :]])
    return parse(text, name="rest", where="rest", folder=folder)


def test_measured_gain_is_that_of_the_zero_state_run(tmp_path: Path) -> None:
    """sqrt(int z'z / int w'w) by Simpson's rule from the rows of a second run."""
    rest = from_rest("auv-acoustic", tmp_path)
    path = tmp_path / "rest.mcap"
    assert rest.scenario.design is not None
    execute_run(prepare(rest, FmuCache(fmu_store(), tmp_path)), path)
    trace = Trace(path)
    x_rows, given = trace.read("/plant/output"), trace.read("/plant/input")
    t = x_rows.log_time_ns / 1e9
    x = columns(x_rows, STATE)
    system = problem_of(rest.scenario.design, tmp_path).system
    u, w = columns(given, FORCE), columns(given, WAVES)
    u = u @ np.array(thrust_map(TABLE_1)).T  # the scenario leaves the vehicle at Table 1
    middle = 0.5 * (x[:-1] + x[1:])
    h = np.diff(t)[:, None]
    out = 0.0
    for weight, state in ((1 / 6, x[:-1]), (4 / 6, middle), (1 / 6, x[1:])):
        z = state @ system.D.T + w[:-1] @ system.D1.T + u[:-1] @ system.D2.T
        out += weight * float((h * z**2).sum())
    gain = np.sqrt(out / float((h * w[:-1] ** 2).sum()))
    assert shared_run("auv-acoustic").json["metrics"]["gain"] == pytest.approx(gain, rel=1e-3)


def oldest_measurement(name: str) -> float:
    """Follow each command in force back to its measurement, message by message."""
    trace = Trace(trace_of(name))
    points = trace.read("/plant/output").log_time_ns
    up, down = trace.read("/link/uplink"), trace.read("/link/downlink")

    def sent(link: Table, now: int) -> int | None:
        """When the newest message that has arrived by `now` was sent."""
        arrived = link.publish_time_ns[link.log_time_ns <= now]
        return int(arrived.max()) if arrived.size else None

    places = {int(t): k for k, t in enumerate(points)}
    # the controller samples in the steps that begin at, or pass over, a multiple of 50 ms
    instants = np.arange(0, points[-1], 50_000_000)
    fresh = np.unique(np.searchsorted(points, instants, side="right") - 1)
    commands = columns(trace.read("/controller/output"), FORCE)
    changed = np.flatnonzero((np.diff(commands, axis=0) != 0).any(axis=1))
    assert set(changed) <= set(fresh)
    oldest = 0
    for k in range(points.size - 1):
        command = sent(down, int(points[k]))
        used = fresh[fresh < places[command]] if command is not None else fresh[:0]
        if not used.size:
            continue
        measured = sent(up, int(points[used[-1]]))
        if measured is not None:
            oldest = max(oldest, int(points[k + 1]) - measured)
    return oldest / 1e9


@pytest.mark.parametrize("name", ACOUSTIC)
def test_oldest_measurement_by_brute_force(name: str) -> None:
    """Publish and log times of the two links alone give the age that the summary claims."""
    assert shared_run(name).json["metrics"]["message_age_s"] == oldest_measurement(name)


@pytest.mark.parametrize("name", ACOUSTIC)
def test_saturated_fraction_by_sorting_instants(name: str) -> None:
    """The share of time with a command at 2500 N or N m, from the commands in the trace."""
    rows = Trace(trace_of(name)).read("/controller/output")
    at_limit = (np.abs(columns(rows, FORCE)) == 2500.0).any(axis=1)
    durations = np.append(np.diff(rows.log_time_ns), 0)
    fraction = durations[at_limit].sum() / rows.log_time_ns[-1]
    metrics = shared_run(name).json["metrics"]
    assert metrics["saturated_fraction"] == pytest.approx(fraction, abs=1e-12)
    for j, command in enumerate(FORCE):
        largest = np.abs(columns(rows, FORCE)[:, j]).max()
        assert metrics["largest_command"][command] == largest


@pytest.mark.parametrize("name", ACOUSTIC)
def test_position_error_and_envelope_from_the_last_rows(name: str) -> None:
    """The distance to the station at the end, and no envelope use below this flight's own."""
    rows = Trace(trace_of(name)).read("/plant/output")
    end = [rows[axis][-1] for axis in ("eta.x", "eta.y", "eta.z")]
    metrics = shared_run(name).json["metrics"]
    assert metrics["position_error_m"] == pytest.approx(np.linalg.norm(end), rel=1e-12)
    bounds = {"u": "nu.u", "v": "nu.v", "w": "nu.w", "r": "nu.r", "psi": "eta.psi"}
    ratios = {
        axis: np.abs(rows[n]).max() / metrics["envelope_use"][axis] for axis, n in bounds.items()
    }
    assert metrics["assumptions"]["state_inside_envelope"] is (
        max(metrics["envelope_use"].values()) <= 1.0
    )
    # largest excursion over use is at most the bound, which is one number for both gains
    assert all(0.0 < ratio < 5.0 for ratio in ratios.values())


@pytest.mark.parametrize("name", ACOUSTIC)
def test_link_figures_from_the_messages(name: str) -> None:
    """Delays are arrival minus sending, of what was delivered; drops have their own topic."""
    trace = Trace(trace_of(name))
    for link, figures in shared_run(name).json["links"].items():
        rows = trace.read(f"/link/{link}")
        delays = (rows.log_time_ns - rows.publish_time_ns) / 1e9
        assert figures["delivered"] == len(rows)
        assert figures["dropped"] == len(trace.read(f"/link/{link}/dropped"))
        assert figures["mean_delay_s"] == pytest.approx(delays.mean(), rel=1e-9)
        assert figures["max_delay_s"] == pytest.approx(delays.max(), abs=1e-9)
        assert delays.min() >= 0.25
        # the largest age: just before an arrival, counted from the newest message until then
        end = int(trace.read("/plant/output").log_time_ns[-1])
        until = np.append(rows.log_time_ns[1:], end)
        newest = np.maximum.accumulate(rows.publish_time_ns)
        assert figures["max_age_s"] == pytest.approx((until - newest).max() / 1e9, abs=1e-9)
