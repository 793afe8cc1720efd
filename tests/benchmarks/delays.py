"""What a delay costs: exact against Pade approximants of order 1 to 10, digits and CPU seconds.

The loops are L = k e^{-s tau} / (s + a), closed by unit feedback. Everything about them has a
closed form, evaluated in forty digits here:

* step response y(t) = sum_j (-1)^(j+1) (k/a)^j P(j, a (t - j tau)), P the regularised incomplete
  gamma function; for a = 0 the polynomials of the method of steps;
* frequency response of the closed loop, entry by entry;
* delay margin (pi - phase lag at |L| = 1) / omega;
* H-infinity norm, the greatest gain by Newton's method on its derivative.

Pade: control.pade, multiplied into the transfer function, closed by control.feedback, and asked by
step_response, frequency response, margin and system_norm of python-control. Digits are
-log10(largest error / largest value). Seconds are CPU seconds, the least of five, without imports.

Prints a table and JSON (--json: JSON alone).
"""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import control
import numpy as np
from rich.table import Table

from cosim.hinf import lti
from cosim.hinf.delay_lti import dead_time, one_thread
from tests.benchmarks._show import show

sys.path.insert(0, str(Path(__file__).parents[1] / "hinf"))
from truth_of_late_loops import LateLoop

LOOPS = {
    "2 e^{-0.5 s} / (s + 1)": LateLoop(2.0, 1.0, 0.5),
    "0.5 e^{-s} / s": LateLoop(0.5, 0.0, 1.0),
    "3 e^{-0.2 s} / (s + 0.1)": LateLoop(3.0, 0.1, 0.2),
}
ORDERS = range(1, 11)
TIMES = np.linspace(0.0, 10.0, 201)
OMEGA = np.geomspace(1e-2, 1e2, 200)
_REPEATS = 5
_MOST_DIGITS = 16.0


class Figure(NamedTuple):
    """Correct digits and CPU seconds of one answer; no digits where there is no answer."""

    digits: float | None
    seconds: float


def _digits(found: Any, truth: Any) -> float | None:
    if found is None or not np.isfinite(found).all():
        return None
    error = np.abs(np.asarray(found) - truth).max() / np.abs(truth).max()
    return _MOST_DIGITS if error == 0 else max(0.0, min(_MOST_DIGITS, -math.log10(error)))


def _measured(ask: Callable[[], Any], truth: Any) -> Figure:
    least = math.inf
    found = None
    for _ in range(_REPEATS):
        begin = time.process_time()
        found = ask()
        least = min(least, time.process_time() - begin)
    return Figure(_digits(found, truth), least)


@one_thread
def _all_measured(asks: dict[str, Callable[[], Any]], known: dict[str, Any]) -> dict[str, Figure]:
    return {what: _measured(ask, known[what]) for what, ask in asks.items()}


def exact(loop: LateLoop) -> dict[str, Callable[[], Any]]:
    """Return what is asked of our systems; each makes the loop anew."""

    def closed() -> Any:
        return open_loop().feedback()

    def open_loop() -> Any:
        return lti(control.tf([loop.k], [1.0, loop.a])) * dead_time(loop.tau)

    return {
        "step": lambda: closed().step_response(TIMES).outputs,
        "frequency": lambda: closed()(1j * OMEGA),
        "margin": lambda: open_loop().margins().delay,
        "norm": lambda: closed().norm().value,
    }


def pade(loop: LateLoop, order: int) -> dict[str, Callable[[], Any]]:
    """Return the same for Pade approximants in python-control."""

    def open_loop() -> Any:
        late = control.tf(*control.pade(loop.tau, order))
        return control.tf([loop.k], [1.0, loop.a]) * late

    def closed() -> Any:
        return control.feedback(open_loop(), 1)

    def margin() -> Any:
        _, phase, _, crossing = control.margin(open_loop())
        return math.radians(phase) / crossing

    return {
        "step": lambda: control.step_response(closed(), TIMES).outputs,
        "frequency": lambda: closed()(1j * OMEGA),
        "margin": margin,
        "norm": lambda: control.system_norm(closed(), "inf", tol=1e-12, print_warning=False),
    }


def truth(loop: LateLoop) -> dict[str, Any]:
    """Return the closed forms."""
    return {
        "step": loop.step(TIMES),
        "frequency": loop.closed_response(OMEGA),
        "margin": loop.delay_margin(),
        "norm": loop.norm(),
    }


def main() -> None:
    """Run it and print."""
    warnings.simplefilter("ignore")  # python-control warns of orders it cannot represent
    view = Table(title="correct digits, CPU milliseconds")
    for head in ("loop", "method", *truth(LOOPS["0.5 e^{-s} / s"])):
        view.add_column(head)
    figures: dict[str, Any] = {}
    for name, loop in LOOPS.items():
        known = truth(loop)
        methods = {"exact": exact(loop)} | {f"Pade {n}": pade(loop, n) for n in ORDERS}
        for method, asks in methods.items():
            row = _all_measured(asks, known)
            figures.setdefault(name, {})[method] = {k: v._asdict() for k, v in row.items()}
            cells = (
                f"{'-' if f.digits is None else f'{f.digits:.1f}'}  {1e3 * f.seconds:.2f}"
                for f in row.values()
            )
            view.add_row(name, method, *cells)
    show(view, figures)


if __name__ == "__main__":
    main()
