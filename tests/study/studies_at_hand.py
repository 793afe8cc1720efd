"""Real studies for what shows studies, each run once per session: the folder, results and traces.

x' = decay (u - x) from x0, as in `study.deadly`: beyond |u| = 600 a run kills its process, and
above x = 400 an assertion fails.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from shared import made_once
from study.deadly import RESULTS, base, planned, study

from cosim.study import Study, execute_study

_PARAMETERS = "components.tiny.parameters"
_ASSERTION = '\n[[assertions]]\nname = "x <i>stays</i> below 400"\nalways = "tiny.x < 400"\n'
METRICS = {
    "x": "final.tiny.x",
    "small": {"path": "final.tiny.x", "below": 100.0},
    "outcome": "status",
    "settled": {"signal": "tiny.x", "reduce": "settling_time", "within": 200.0},
}


def grid(name: str, values: list[Any]) -> dict[str, Any]:
    """Return a grid axis over a parameter."""
    return {"kind": "grid", "name": name, "path": f"{_PARAMETERS}.{name}", "values": values}


def drawn(name: str, kind: str = "random", **distribution: Any) -> dict[str, Any]:
    """Return a sampled axis over a parameter."""
    return {"kind": kind, "name": name, "path": f"{_PARAMETERS}.{name}", **distribution}


STUDIES: Mapping[str, Callable[[], Study]] = MappingProxyType(
    {
        "mixed": lambda: study(
            [],
            title="x follows <b>u</b>, and dies",
            samples=8,
            vary=[
                grid("x0", [0.0, 1.0, 50.0]),
                grid("decay", [0.5, 1.0]),
                drawn("u", uniform=[-700.0, 700.0]),
            ],
            metrics=METRICS,
            traces="worst:2 by x",
        ),
        "dead": lambda: study([610.0, 650.0, 700.0], metrics=METRICS, title="All die"),
        "few": lambda: study([10.0, 50.0, 100.0], metrics=METRICS, title="A few"),
        "one": lambda: study([3.0], metrics=METRICS, title="One run"),
        "indices": lambda: study(
            [],
            title="What the end depends on",
            samples=8,
            vary=[
                drawn("u", "saltelli", uniform=[-1.0, 1.0]),
                drawn("x0", "saltelli", uniform=[-1.0, 5.0]),
            ],
        ),
        "rare": lambda: study(
            [],
            title="A rare end",
            samples=100,
            rare={"metric": "x", "above": 1.0, "levels": 4},
            vary=[drawn("u", normal=[0.0, 1.0]), drawn("x0", normal=[0.0, 1.0])],
        ),
    }
)


def study_folder(name: str) -> Path:
    """Return the folder of one of `STUDIES`, which is finished."""
    folder = made_once(
        f"studies/{name}",
        lambda folder: execute_study(
            planned(STUDIES[name](), base(more=_ASSERTION)), folder / name
        ),
    )
    assert (folder / name / RESULTS).exists()
    return folder / name
