"""The observer against plant, observer and links written out with SciPy: the method's order."""

from __future__ import annotations

import math
from bisect import bisect_right
from itertools import pairwise
from typing import Any

import numpy as np
import pairs
import pytest
from scipy.integrate import solve_ivp

A, B = np.array(pairs.PLANT["A"]), np.array(pairs.PLANT["B"])
A1, LATE = np.array(pairs.PLANT["delays"][0]["A"]), pairs.PLANT["delays"][0]["d"]
K = np.array(pairs.CERTIFICATE["K"])
C = {one["name"]: np.array(one["C"]) for one in (pairs.FIX, pairs.SPEED)}
L = {"fix": np.array(pairs.L_FIX), "dvl": np.array(pairs.L_SPEED)}
GRID, END = 0.2, 8.0  # arrivals are at multiples of the one [s]
SAMPLE, PLAY_OUT, LIMIT = 0.4, 0.13, 0.12


def packets(seed: int) -> list[tuple[float, str, float]]:
    """(arrival, name, stamp): late, some lost, some overtaken, in the order of arrival."""
    seeded, found = np.random.default_rng(seed), []
    for name, apart, most in (("fix", 0.5, 1.3), ("dvl", 0.15, 0.4)):
        for k in range(math.ceil(END / apart)):
            stamp = 0.03 + k * apart
            arrival = GRID * math.ceil((stamp + seeded.uniform(0.0, most)) / GRID)
            if seeded.random() > 0.3:
                found.append((round(arrival, 9), name, stamp))
    return sorted(found)


class Truth:
    """x and xh piece by piece, by DOP853 between the instants at which anything jumps."""

    def __init__(self) -> None:
        self.ends: list[float] = []
        self.pieces: list[Any] = []
        self.in_use = {"fix": np.zeros(1), "dvl": np.zeros(2)}
        self.sent: dict[tuple[float, str], np.ndarray] = {}  # what a sensor measured
        self.commands: list[tuple[float, float]] = [(-1.0, 0.0)]  # when one acts
        self.used = {"fix": -1.0, "dvl": -1.0}

    def at(self, t: float) -> np.ndarray:
        """(x, xh) at a time."""
        if t <= 0.0 or not self.ends:
            return np.array([0.8, -0.1, 0.0, 0.0, 0.0, 0.0])
        return self.pieces[min(bisect_right(self.ends, t), len(self.ends) - 1)](t)

    def u(self, t: float) -> float:
        """The control that acts."""
        return [value for when, value in self.commands if when <= t + 1e-12][-1]

    def rate(self, t: float, both: np.ndarray, u: float) -> np.ndarray:
        """Plant with a disturbance, and observer."""
        late = self.at(t - LATE)
        w = np.array([0.0, 0.05 * math.sin(0.7 * t), 0.0])
        injected = sum(L[name] @ self.in_use[name] for name in L)
        x = A @ both[:3] + A1 @ late[:3] + B[:, 0] * u + w
        return np.concatenate((x, A @ both[3:] + A1 @ late[3:] + B[:, 0] * u + injected))

    def to(self, begin: float, end: float) -> None:
        """Integrate between two points at which nothing arrives or acts."""
        u = self.u(begin)
        found = solve_ivp(
            *(self.rate, (begin, end), self.at(begin)),
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
            args=(u,),
            dense_output=True,
        )
        self.pieces.append(found.sol)
        self.ends.append(end)

    def run(self, arrivals: list[tuple[float, str, float]]) -> Truth:
        """To the end."""
        grid = [k * GRID for k in range(round(END / GRID) + 1)]
        jumps = sorted({*grid, *(t + PLAY_OUT for t in grid)})
        stops = sorted({round(t + m * LATE, 9) for t in jumps for m in range(5)} | {0.0})
        stops = [t for t in stops if t <= END]
        for begin, end in pairwise(stops):
            for arrival, name, stamp in arrivals:
                if arrival == round(begin, 9) and stamp > self.used[name]:
                    self.used[name] = stamp
                    y = self.measured(name, stamp)
                    self.in_use[name] = y - C[name] @ self.at(stamp)[3:]
            self.to(begin, end)
            if end % SAMPLE < 1e-9 or SAMPLE - end % SAMPLE < 1e-9:
                wanted = float((K @ self.at(end)[3:])[0])
                self.commands.append((end + PLAY_OUT, max(-LIMIT, min(LIMIT, wanted))))
        return self

    def measured(self, name: str, stamp: float) -> np.ndarray:
        """What the sensor measures: with an error that depends on the time alone."""
        y = C[name] @ self.at(stamp)[:3] + 0.05 * math.cos(3.0 * stamp)
        self.sent[stamp, name] = y
        return y


@pytest.fixture(scope="module")
def truth() -> tuple[Truth, list[tuple[float, str, float]]]:
    arrivals = packets(3)
    return Truth().run(arrivals), arrivals


def estimates(
    truth: tuple[Truth, list[tuple[float, str, float]]], step: float, solver_step: float
) -> tuple[np.ndarray, pairs.Equations]:
    """Estimates at the points of the grid, at a communication step."""
    solution, arrivals = truth
    spec = pairs.VARIABLES.output_feedback_spec(
        "Pair",
        pairs.content(measurements=[{**one, "d": 4.0} for one in (pairs.FIX, pairs.SPEED)]),
        sample_time=SAMPLE,
        limits=[LIMIT],
        command_delay=PLAY_OUT,
    )
    own = pairs.Equations(spec, {"solver.step": solver_step})
    found, count = [], round(GRID / step)
    for k in range(round(END / step)):
        inputs: dict[str, float] = {}
        if k % count == 0:
            now = round(k * step, 9)
            for _, name, stamp in [one for one in arrivals if one[0] == now]:
                y = solution.sent.get((stamp, name))
                if y is None:
                    continue  # overtaken: the observer has a newer one
                inputs |= {f"{name}[{i}]": float(v) for i, v in enumerate(y, 1)}
                inputs[f"stamp.{name}"] = stamp
        own.step((k + 1) * step, inputs)
        if (k + 1) % count == 0:
            found.append([own.v[f"estimate[{i}]"] for i in (1, 2, 3)])
    return np.array(found), own


def test_estimates_agree_to_the_order_of_the_method(truth: Any) -> None:
    """Plant, observer, late and lost packets, limits, play-out: halving the step gives 16."""
    solution, _ = truth
    exact = np.array([solution.at((k + 1) * GRID)[3:] for k in range(round(END / GRID))])
    errors = []
    for solver_step in (0.1, 0.05, 0.025):
        found, own = estimates(truth, GRID, solver_step)
        errors.append(float(np.abs(found - exact).max()))
    assert np.ptp(exact[:, 0]) > 0.3  # it moves
    assert own.v["assumption.saturation"] > 1.2  # and its command is limited
    assert errors[0] < 2e-5
    assert errors[2] < 2e-7
    assert all(11.0 < a / b < 22.0 for a, b in pairwise(errors)), errors


def test_the_communication_step_does_not_matter(truth: Any) -> None:
    """Halved and halved again, with the same arrivals: as much as the order of the method."""
    rows = [estimates(truth, step, 0.025)[0] for step in (GRID, GRID / 2, GRID / 4)]
    for other in rows[1:]:
        np.testing.assert_allclose(other, rows[0], atol=1e-7, rtol=0)
