"""Rows of Figures 1 to 3, and the simulated curves that take the place of Figures 2 and 3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cosim.models import TABLE_1, paper_example as printed
from cosim.paper.row import FIGURES, How, Row, Verdict
from cosim.paper.simulation import SimulatedRun, simulate

_END, _POINTS = 10.0, 401


@dataclass(frozen=True, eq=False)
class Curves:
    """The simulated run that takes the place of Figures 2 and 3.

    run : from x = (10, 10), F = 0.5 sin t, w = sin t, d = 0.3 s.
    settled : time after which |x| stays below a tenth of its initial value [s].
    """

    run: SimulatedRun
    settled: float

    def to_json(self) -> dict[str, Any]:
        """Return the curves as plain JSON values."""
        f = self.run
        drawn = {"x1": f.x[:, 0], "x2": f.x[:, 1], "u": f.u, "w": f.w}
        times = [round(v, 6) for v in f.t.tolist()]
        return {"t": times} | {k: [round(v, 9) for v in c.tolist()] for k, c in drawn.items()}


def curves() -> Curves:
    """Simulate the run of section 5, with the choices that `figure_rows` states."""
    run = simulate(
        initial=printed.INITIAL_STATE,
        frequency=1.0,
        amplitude=printed.F_AMPLITUDE,
        end=_END,
        points=_POINTS,
    )
    size = abs(run.x).max(axis=1)
    unsettled = [t for t, s in zip(run.t, size, strict=True) if s > size[0] / 10]
    return Curves(run, max(unsettled))


def figure_rows(drawn: Curves) -> list[Row]:
    """Return one row per figure."""
    f = drawn.run
    return [
        Row(
            FIGURES,
            "Figure 1, the AUV model",
            "a drawing of the frames",
            f"our drawing: the hull of {TABLE_1['length']:g} m in the earth and body frames",
            None,
            Verdict.NOT_COMPARABLE,
            "The text has only the caption, and no result depends on the picture.",
        ),
        Row(
            FIGURES,
            "Figure 2, the curve of state variables",
            "a picture without numbers in the text",
            f"our run: from (10, 10) below a tenth of that after {drawn.settled:.2f} s; then "
            f"|x| ≤ {_tail(abs(f.x).max(axis=1), f.t):.3f}",
            How.MEASURED,
            Verdict.NOT_COMPARABLE,
            "Printed K, d = 0.3 s, F = 0.5 sin t. The text gives no w(0) and no φ(t) for t < 0: "
            "here w = sin t and φ = (10, 10).",
            value=drawn.settled,
        ),
        Row(
            FIGURES,
            "Figure 3, the curve of control u(t)",
            "a picture without numbers in the text",
            f"our run: u(0) = {f.u[0]:.3f}, largest |u| {abs(f.u).max():.3f}; after 5 s "
            f"|u| ≤ {_tail(abs(f.u), f.t):.3f}",
            How.MEASURED,
            Verdict.NOT_COMPARABLE,
            "u = K x of the run of Figure 2.",
            value=float(abs(f.u).max()),
        ),
    ]


def _tail(size: Any, t: Any) -> float:
    return float(size[t >= _END / 2].max())
