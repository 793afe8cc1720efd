"""The built-in scenarios do what their descriptions say."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from cli.shell import BUILT_IN, shared_run, trace_of
from truth.dde import solve

from cosim.hinf import check_certificate
from cosim.trace import Trace

KEYS = {"scenario", "status", "trace", "steps", "simulated_s", "wall_s", "final", "metrics"}
METRICS = {"gain", "gamma", "position_error_m", "saturated_fraction", "assumptions"}
LINK = {"sent", "delivered", "dropped", "mean_delay_s", "max_delay_s", "max_age_s"}


@pytest.mark.parametrize("name", BUILT_IN)
def test_output_has_the_promised_keys(name: str) -> None:
    """One JSON object with the documented keys, its trace where it says, no message."""
    result = shared_run(name)
    assert result.code == 0
    assert result.err == ""
    data = result.json
    assert KEYS | {"links"} <= set(data)
    assert data["scenario"] == name
    assert data["status"] in {"finished", "limit_cycle", "diverged", "failed"}
    assert set(data["metrics"]) >= METRICS
    assert all(isinstance(met, bool) for met in data["metrics"]["assumptions"].values())
    assert data["trace"] == f"traces/{name}.mcap"
    assert trace_of(name).is_file()
    assert data["steps"] + 1 == len(Trace(trace_of(name)).read("/plant/output"))
    for figures in data["links"].values():
        assert set(figures) >= LINK
        assert figures["sent"] == (figures["delivered"] + figures["dropped"] + figures["in_flight"])


def test_gain_designed_for_the_link_meets_every_assumption() -> None:
    """Delay-aware: finished, measured gain below the certified one, every assumption met."""
    data = shared_run("auv-acoustic").json
    metrics = data["metrics"]
    assert data["status"] == "finished"
    assert 0.0 < metrics["gain"] < metrics["gamma"]
    assert metrics["exact_norm"] <= metrics["gamma"]
    assert metrics["position_error_m"] < 0.5
    assert metrics["saturated_fraction"] < 0.2
    assert metrics["assumptions"]
    assert all(metrics["assumptions"].values())
    assert set(data["links"]) == {"uplink", "downlink"}


def test_gain_designed_without_the_link_ends_in_a_limit_cycle() -> None:
    """Naive: over the same link the limits bound the motion, and the status says so."""
    naive, aware = shared_run("auv-acoustic-naive"), shared_run("auv-acoustic")
    assert naive.code == 0
    assert naive.json["status"] in {"limit_cycle", "diverged"}
    assert naive.json["metrics"]["saturated_fraction"] > 0.8
    assert naive.json["metrics"]["assumptions"]["message_age_within_design"] is False
    assert naive.json["metrics"]["assumptions"]["certificate_verified"] is True
    assert naive.json["links"] == aware.json["links"]


def test_cable_runs_with_a_higher_gain_and_no_link() -> None:
    """Direct: every assumption met, no links, a smaller gamma than over the link."""
    direct = shared_run("auv-direct").json
    assert direct["status"] == "finished"
    assert direct["links"] == {}
    assert all(direct["metrics"]["assumptions"].values())
    assert direct["metrics"]["gamma"] < shared_run("auv-acoustic").json["metrics"]["gamma"]


def closed_loop(t: float, x: np.ndarray, late: list[np.ndarray]) -> np.ndarray:
    """Section 5 under continuous u = K x, from the print: F = 0.5 sin t, w = sin t."""
    A = np.array([[-5.0, 0.0], [6.0, -10.0]])
    A1 = np.array([[-1.0, 0.0], [2.0, 1.0]])
    B, C, K = np.array([-1.0, 3.0]), np.array([4.0, 3.0]), np.array([0.6432, -0.5679])
    H, H1 = np.array([[0.2, 0.0], [1.0, 2.0]]), np.array([[-1.0, 2.0], [0.0, -0.3]])
    uncertain = -0.1 * 0.5 * math.sin(t) * (H @ x + H1 @ late[0])
    rate: np.ndarray = A @ x + A1 @ late[0] + B * (K @ x) + C * math.sin(t) + uncertain
    return rate


def test_paper_example_is_the_loop_of_the_paper() -> None:
    """Section 5: x(t) from (10, 10) is that of the closed loop, within what the sampling adds."""
    data = shared_run("paper-example").json
    assert data["status"] == "finished"
    # designed for feedback without any delay; the loop of two components has one of two steps
    unmet = [name for name, met in data["metrics"]["assumptions"].items() if not met]
    assert unmet == ["message_age_within_design"]
    assert data["metrics"]["message_age_s"] == pytest.approx(0.02)
    trace = Trace(trace_of("paper-example"))
    x, given = trace.read("/plant/output"), trace.read("/plant/input")
    t = x.log_time_ns / 1e9
    np.testing.assert_allclose(given["w[1]"], np.sin(t), rtol=0, atol=1e-12)
    assert (x["x[1]"][0], x["x[2]"][0]) == (10.0, 10.0)
    exact = solve(closed_loop, [10.0, 10.0], [0.3], 10.0, rtol=1e-9, atol=1e-10).sample(t[::20])
    got = np.column_stack([x["x[1]"], x["x[2]"]])[::20]
    # one step late and held for another: 0.02 s times rates of up to |B K x'| = 2 |x'|
    assert np.abs(got - exact).max() < 0.03 * np.abs(exact).max()
    assert np.abs(got - exact)[t[::20] >= 5.0].max() < 0.02
    assert np.abs(exact[t[::20] >= 5.0]).max() > 0.5


def test_printed_gain_is_in_the_trace() -> None:
    """K = (0.6432 -0.5679) flew, proved as it flew, and the command is K x of the last sample."""
    trace = Trace(trace_of("paper-example"))
    design = json.loads(trace.attachments["design.json"])
    assert design["K"] == [[0.6432, -0.5679]]
    assert check_certificate(design).valid
    measured, command = trace.read("/controller/input"), trace.read("/controller/output")
    expected = 0.6432 * measured["x[1]"] - 0.5679 * measured["x[2]"]
    np.testing.assert_allclose(command["u[1]"][1:], expected[:-1], rtol=1e-14, atol=1e-14)
