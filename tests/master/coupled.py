"""The section 5 loop and smaller systems, put together for the tests of the master."""

from __future__ import annotations

import re
import zipfile
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cosim.fmu import describe_fmu
from cosim.master import (
    Component,
    Connection,
    Endpoint,
    Link,
    System,
    make_schedule,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

K = np.array([[0.6432, -0.5679]])
A = np.array([[-5.0, 0.0], [6.0, -10.0]])
A1 = np.array([[-1.0, 0.0], [2.0, 1.0]])
B = np.array([-1.0, 3.0])
C = np.array([4.0, 3.0])
E = -0.1 * np.eye(2)
H = np.array([[0.2, 0.0], [1.0, 2.0]])
H1 = np.array([[-1.0, 2.0], [0.0, -0.3]])
DELAY = 0.3

ONE_SINE = {
    "spectrum": 0,
    "omega[1]": 1.0,
    "amplitude[1]": 1.0,
    "gain.u": 1.0,
    "gain.v": 0.0,
    "gain.w": 0.0,
    "gain.r": 0.0,
}
"""WaveField as w = sin t on its first output."""


def ns(seconds: float) -> int:
    return round(seconds * 1e9)


def end(text: str) -> Endpoint:
    """plant.x[1] -> Endpoint("plant", "x[1]")."""
    component, _, variable = text.partition(".")
    return Endpoint(component, variable)


def system(
    fmus: Path,
    components: Mapping[str, tuple[str, Mapping[str, float]]],
    connections: Sequence[tuple[str, ...]],
    *,
    step: float,
    stop: float,
    links: Sequence[Link] = (),
    events: Literal["align", "grid"] = "align",
    driven: Mapping[str, Callable[[float], float]] | None = None,
    divergence: float | None = 1e6,
) -> System:
    """A system of FMUs by name; connections are (from, to) or (from, to, link)."""
    named = {link.name: link for link in links}
    comm_schedule = make_schedule(named, ns(step), ns(stop), events)
    seconds = comm_schedule.points_ns / 1e9
    return System(
        components={
            name: Component(describe_fmu(fmus / f"{fmu}.fmu"), parameters)
            for name, (fmu, parameters) in components.items()
        },
        connections=[Connection(end(c[0]), end(c[1]), *c[2:]) for c in connections],
        links=named,
        driven={end(k): np.array([f(t) for t in seconds]) for k, f in (driven or {}).items()},
        comm_schedule=comm_schedule,
        divergence=divergence,
    )


def section_5(
    fmus: Path,
    *,
    step: float,
    stop: float,
    links: Sequence[Link] = (),
    plant: Mapping[str, float] | None = None,
    **more: Any,
) -> System:
    """Plant, printed controller and w = sin t; links named "sc" and "ca" are put in place."""
    names = {link.name for link in links}
    there = ("sc",) if "sc" in names else ()
    back = ("ca",) if "ca" in names else ()
    return system(
        fmus,
        {
            "plant": ("DelayedPlant", plant or {}),
            "controller": ("PaperController", {}),
            "sea": ("WaveField", ONE_SINE),
        },
        [
            ("plant.x[1]", "controller.x[1]", *there),
            ("plant.x[2]", "controller.x[2]", *there),
            ("controller.u[1]", "plant.u[1]", *back),
            ("sea.disturbance.u", "plant.w[1]"),
        ],
        step=step,
        stop=stop,
        links=links,
        **more,
    )


def rewritten(source: Path, target: Path, *changes: tuple[str, str]) -> Path:
    """A copy of an FMU with its model description changed, each pattern exactly once."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for entry in old.infolist():
            content = old.read(entry)
            if entry.filename == "modelDescription.xml":
                text = content.decode()
                for pattern, replacement in changes:
                    text, count = re.subn(pattern, replacement, text)
                    assert count == 1, pattern
                content = text.encode()
            new.writestr(entry, content)
    return target
