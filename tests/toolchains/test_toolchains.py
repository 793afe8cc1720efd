"""Our FMUs in tools that no one here wrote, against our own master without links."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray
from toolchains import by_container, by_ecos, by_fmpy, by_libcosim
from toolchains.flight import Flight, Part, flown, label

from cosim.fmu import describe_fmu
from cosim.master import Component, Connection, Endpoint, System, make_timetable, simulate

TOOLS = {"fmpy": by_fmpy, "libcosim": by_libcosim, "ecos": by_ecos, "container": by_container}
TOLERANCE = 1e-9
SINE: Mapping[str, float | int] = {
    "spectrum": 0,
    "omega[1]": 1.0,
    "amplitude[1]": 1.0,
    "gain.v": 0.0,
    "gain.w": 0.0,
    "gain.r": 0.0,
}
THRUST = ("force.x", "force.y", "force.z", "moment.z")
MOTION = ("eta.x", "eta.y", "eta.z", "eta.psi", "nu.u", "nu.v", "nu.w", "nu.r")
SEA = tuple(f"disturbance.{axis}" for axis in "uvwr")

PARTS: dict[str, tuple[str, Mapping[str, float | int]]] = {
    "plant": ("DelayedPlant", {}),
    "controller": ("PaperController", {}),
    "sine": ("WaveField", SINE),
    "sea": ("WaveField", {"seed": 7, "Hs": 1.5, "components": 12}),
    "vehicle": ("AuvPlant", {"initial.eta.x": 3.0, "initial.nu.u": 0.5, "delay.d": 0.3}),
    "pilot": ("HinfController", {"limit.force": 2500.0}),
}
COUPLED: dict[str, tuple[tuple[str, ...], tuple[tuple[str, str, str, str], ...]]] = {
    "section 5": (
        ("plant", "controller", "sine"),
        (
            ("plant", "x[1]", "controller", "x[1]"),
            ("plant", "x[2]", "controller", "x[2]"),
            ("controller", "u[1]", "plant", "u[1]"),
            ("sine", "disturbance.u", "plant", "w[1]"),
        ),
    ),
    "vehicle": (
        ("vehicle", "pilot", "sea"),
        tuple(
            [("vehicle", name, "pilot", name) for name in MOTION]
            + [("pilot", name, "vehicle", name) for name in THRUST]
            + [("sea", name, "vehicle", name) for name in SEA]
        ),
    ),
}
OUTPUTS = {
    "plant": ("x[1]", "x[2]"),
    "controller": ("u[1]",),
    "sine": SEA,
    "sea": SEA,
    "vehicle": MOTION,
    "pilot": THRUST,
}


def flight(
    fmus: Path,
    names: tuple[str, ...],
    wires: tuple[tuple[str, str, str, str], ...],
    step_ns: int,
    steps: int,
) -> Flight:
    """Parts by name, every output watched."""
    return Flight(
        parts={n: Part(str(fmus / f"{PARTS[n][0]}.fmu"), PARTS[n][1]) for n in names},
        wires=wires,
        step_ns=step_ns,
        steps=steps,
        watch=tuple((n, output) for n in names for output in OUTPUTS[n]),
    )


def ours(flown_by_us: Flight) -> dict[str, NDArray[np.float64]]:
    """The same by this project's master: every connection a wire."""
    end_ns = flown_by_us.step_ns * flown_by_us.steps
    system = System(
        components={
            name: Component(describe_fmu(Path(part.fmu)), part.parameters)
            for name, part in flown_by_us.parts.items()
        },
        connections=[
            Connection(Endpoint(a, o), Endpoint(b, i)) for a, o, b, i in flown_by_us.wires
        ],
        links={},
        driven={},
        timetable=make_timetable({}, flown_by_us.step_ns, end_ns, "align"),
        divergence=1e9,
    )
    run = simulate(system)
    assert run.ending == "finished", run.reason
    return {label(*watched): run.signal(*watched)[1:] for watched in flown_by_us.watch}


def assert_equal(
    found: Mapping[str, NDArray[np.float64]], expected: Mapping[str, NDArray[np.float64]]
) -> None:
    """To 1e-9 of each signal's size, and the signals are not all at rest."""
    assert set(found) == set(expected)
    assert any(np.ptp(row) > 1e-3 for row in expected.values())
    for name, row in expected.items():
        scale = max(1.0, float(np.abs(row).max()))
        assert np.abs(found[name] - row).max() <= TOLERANCE * scale, name


@pytest.mark.parametrize("tool", TOOLS.values(), ids=TOOLS)
@pytest.mark.parametrize("loop", COUPLED)
def test_loop_is_that_of_our_master(
    fmus: Path, tmp_path: Path, tool: ModuleType, loop: str
) -> None:
    """Plant, controller and disturbance, each tool with its own loop."""
    step = {"section 5": 10_000_000, "vehicle": 50_000_000}[loop]
    asked = flight(fmus, *COUPLED[loop], step, 200)
    assert_equal(flown(tool, asked, tmp_path), ours(asked))


@pytest.mark.parametrize("tool", TOOLS.values(), ids=TOOLS)
@pytest.mark.parametrize("name", ["plant", "sea", "vehicle"])
def test_fmu_alone_is_that_of_our_master(
    fmus: Path, tmp_path: Path, tool: ModuleType, name: str
) -> None:
    """Each moving FMU by itself, from its own start."""
    asked = flight(fmus, (name,), (), 20_000_000, 50)
    assert_equal(flown(tool, asked, tmp_path), ours(asked))
