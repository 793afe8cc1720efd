"""One flight: a scenario file is run, and what it claims is held against what its rows show.

What a run says is read at one place, `claims`; the truth is computed here from recorded outputs of
the plant alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from falsifier.loop import Data, Loop
from falsifier.parts import make_parts_of
from numpy.typing import NDArray

from cosim import CosimError, Trace, run

HUNDREDFOLD = 100.0
"""A state that grows so much over its start is no state of a stable loop of these kinds."""
ROUNDING = 1.02
"""Between the integrals of z'z and w'w and sums over points of a hundredth of a second."""


def claims(outcome: Any) -> bool:
    """Whether a run claims its guarantee: there are assumptions, and all of them are met."""
    assumptions = outcome.metrics.get("assumptions") or {}
    return bool(assumptions) and all(assumptions.values())


@dataclass(frozen=True)
class Flight:
    """What a run said, and what its rows show.

    Attributes
    ----------
    text : the scenario.
    refused : the message of a scenario that was refused before it ran; None: it ran.
    broke : an error that no user may see, in place of an outcome.
    status : of the run.
    claimed : whether the run claims its guarantee.
    unmet : the assumptions that it says are not met.
    growth : largest state over the start; None: not applicable.
    gain, gamma : measured from the rows, and certified; None where there are none.
    """

    text: str
    refused: str | None = None
    broke: str | None = None
    status: str = ""
    claimed: bool = False
    unmet: tuple[str, ...] = ()
    growth: float | None = None
    gain: float | None = None
    gamma: float | None = None
    answers: dict[str, bool] = field(default_factory=dict)

    @property
    def wrong(self) -> str:
        """Why the guarantee does not hold, as the rows show; empty if they do not."""
        if self.status in {"diverged", "limit_cycle"}:
            return self.status
        if self.growth is not None and not self.growth <= HUNDREDFOLD:
            return f"a state grows {self.growth:.3g}-fold"
        if self.gain is not None and self.gamma and not self.gain <= ROUNDING * self.gamma:
            return f"gain {self.gain:.3g} above gamma {self.gamma:.3g}"
        return ""


class Field:
    """A folder in which scenarios are flown, and into which their parts are made when needed."""

    def __init__(self, folder: Path, fmus: Path, name: str = "case") -> None:
        self._folder, self._fmus, self._name = folder, fmus, name
        folder.mkdir(parents=True, exist_ok=True)

    @property
    def trace(self) -> Path:
        """The trace of the last flight that was not refused."""
        return self._folder / f"{self._name}.mcap"

    def fly(self, loop: Loop, data: Data, **options: Any) -> Flight:
        """Run one scenario of a kind; `options` are those of `cosim.run`."""
        make_parts_of(data, self._folder)
        text = tomli_w.dumps(data)
        path, trace = self._folder / f"{self._name}.toml", self.trace
        path.write_text(text, "utf-8")
        trace.unlink(missing_ok=True)
        options = {"supervise": False, "fmus": self._fmus} | options
        try:
            outcome = run(path, trace, **options)
        except CosimError as error:
            return Flight(text, refused=str(error))
        except Exception as error:  # noqa: BLE001 - a traceback is a finding as well
            return Flight(text, broke=f"{type(error).__name__}: {error}")
        answers = outcome.metrics.get("assumptions") or {}
        read = Trace(trace)
        driven = "inputs" in data and any(
            f"plant.{w}" in part.get("values", {})
            for part in data["inputs"]
            for w in loop.disturbances
        )
        return Flight(
            text,
            status=outcome.status,
            claimed=claims(outcome),
            unmet=tuple(name for name, met in answers.items() if not met),
            growth=None if driven else _growth(read, loop, data),
            gain=_gain(read, loop) if driven else None,
            gamma=outcome.metrics.get("gamma"),
            answers=dict(answers),
        )


def _growth(trace: Trace, loop: Loop, data: Data) -> float:
    """Largest magnitude of a state over the largest one at the start, or of the estimate then."""
    start, largest = 0.0, 0.0
    for name in loop.states:
        values = np.abs(trace.signal(f"plant.{name}").values.astype(float))
        start = max(start, float(values[0]))
        largest = max(largest, float(np.max(np.where(np.isnan(values), math.inf, values))))
    parts = data["components"].values()
    given = [
        abs(value)
        for part in parts
        for name, value in part.get("parameters", {}).items()
        if name.startswith("initial.") and isinstance(value, int | float)
    ]
    return largest / max(start, *given, 1e-3) if given else largest / max(start, 1e-3)


def _gain(trace: Trace, loop: Loop) -> float | None:
    """Square root of the energy of z over that of w, from the rows of a linear plant."""
    outputs = [name for name in trace.signals if name.startswith("plant.z[")]
    if not outputs:
        return None
    energy_z = energy_w = 0.0
    for name in outputs:
        series = trace.signal(name)
        values, steps = _squared(series.values), np.diff(series.delivered)
        energy_z += float(np.sum(0.5 * (values[:-1] + values[1:]) * steps))
    for name in loop.disturbances:
        series = trace.signal(f"plant.{name}")
        values, steps = _squared(series.values), np.diff(series.delivered)
        energy_w += float(np.sum(values[:-1] * steps))
    return None if energy_w == 0.0 else math.sqrt(energy_z / energy_w)


def _squared(values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the squares; infinite ones of a loop that flies away."""
    with np.errstate(over="ignore"):
        return np.asarray(values.astype(float) ** 2)
