"""Our FMUs in foreign tools, compared with our own master without links."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import fmu_folder, sampled
from toolchains import ecos_program
from toolchains.peer_run import TOOLS, Part, PeerRun, Tool, label, run_peer

from cosim.fmu import describe_fmu
from cosim.fmu.export import CATALOGUE, FMI_VERSION
from cosim.fmu.inspect import inspect_fmu
from cosim.master import Component, Connection, Endpoint, System, make_schedule, simulate

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
    "fix": ("Sensor", {"sample_time": 0.1, "seed": 5}),
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
        ("vehicle", "pilot", "sea", "fix"),
        tuple(
            [("vehicle", name, "pilot", name) for name in MOTION]
            + [("pilot", name, "vehicle", name) for name in THRUST]
            + [("sea", name, "vehicle", name) for name in SEA]
            + [("vehicle", name, "fix", f"u[{i}]") for i, name in enumerate(MOTION[:4], 1)]
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
    "fix": ("y[1]", "y[2]", "y[3]", "y[4]", "stamp"),
}


FLAVOURS = tuple(FMI_VERSION)
ALONE: Mapping[str, Mapping[str, float]] = {
    "controller": {"x[1]": 10.0},
    "pilot": {"reference.x": 2.0, "eta.x": 1.0},
}


def taken(flavour: str, tool: Tool) -> tuple[Path, Path]:
    """The FMU folders of a tool and our master; skipped if FMI's version is not the tool's.

    Our master takes FMI 2: of what is built for FMI 3 it flies the same core for FMI 2.
    """
    version = FMI_VERSION[flavour].partition(".")[0]
    if version not in tool.versions:
        pytest.skip(f"{tool.file} takes FMI {' and '.join(tool.versions)} only")
    ours_instead = {"native-fmi3": "native"}.get(flavour, flavour)
    return fmu_folder(flavour), fmu_folder(ours_instead)


def peer_run(
    fmus: Path,
    names: tuple[str, ...],
    wires: tuple[tuple[str, str, str, str], ...],
    step_ns: int,
    steps: int,
    first: Mapping[str, float] | None = None,
) -> PeerRun:
    """Parts by name, every output recorded; `first` are further start values of the first part."""
    reported = {n: dict(PARTS[n][1]) for n in names}
    reported[names[0]] |= first or {}
    return PeerRun(
        parts={n: Part(str(fmus / f"{PARTS[n][0]}.fmu"), reported[n]) for n in names},
        wires=wires,
        step_ns=step_ns,
        steps=steps,
        watch=tuple((n, output) for n in names for output in OUTPUTS[n]),
    )


def ours(peer_run: PeerRun) -> dict[str, NDArray[np.float64]]:
    """Run the same by this project's master, with direct connections."""
    end_ns = peer_run.step_ns * peer_run.steps
    system = System(
        components={
            name: Component(describe_fmu(Path(part.fmu)), part.parameters)
            for name, part in peer_run.parts.items()
        },
        connections=[Connection(Endpoint(a, o), Endpoint(b, i)) for a, o, b, i in peer_run.wires],
        links={},
        driven={},
        comm_schedule=make_schedule({}, peer_run.step_ns, end_ns, "align"),
        divergence=1e9,
    )
    run = simulate(system)
    assert run.status == "finished", run.reason
    return {label(*watched): run.signal(*watched)[1:] for watched in peer_run.watch}


def assert_equal(
    found: Mapping[str, NDArray[np.float64]], expected: Mapping[str, NDArray[np.float64]]
) -> None:
    """To 1e-9 of each signal's size, and the signals are not all zero."""
    assert set(found) == set(expected)
    assert any(np.abs(row).max() > 1e-3 for row in expected.values())
    for name, row in expected.items():
        scale = max(1.0, float(np.abs(row).max()))
        assert np.abs(found[name] - row).max() <= TOLERANCE * scale, name


@pytest.mark.parametrize("tool", TOOLS.values(), ids=TOOLS)
@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("loop", COUPLED)
def test_loop_agrees_with_our_master(tmp_path: Path, tool: Tool, flavour: str, loop: str) -> None:
    """Plant, controller and disturbance, each tool with its own algorithm."""
    names, wires = COUPLED[loop]
    step = {"section 5": 10_000_000, "vehicle": 50_000_000}[loop]
    theirs, own = taken(flavour, tool)
    found = run_peer(tool, peer_run(theirs, names, wires, step, 200), tmp_path)
    assert_equal(found, ours(peer_run(own, names, wires, step, 200)))


@pytest.mark.parametrize("tool", TOOLS.values(), ids=TOOLS)
@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("name", sampled(PARTS, 4))
def test_single_fmu_agrees_with_our_master(
    tmp_path: Path, tool: Tool, flavour: str, name: str
) -> None:
    """Each FMU by itself, from its own start and inputs."""
    theirs, own = taken(flavour, tool)
    found = run_peer(tool, peer_run(theirs, (name,), (), 20_000_000, 50, ALONE.get(name)), tmp_path)
    assert_equal(found, ours(peer_run(own, (name,), (), 20_000_000, 50, ALONE.get(name))))


def test_comparison_detects_a_change_of_a_millionth(fmus: Path) -> None:
    """A slightly different delay or connection fails: the tolerance is tight enough."""
    names, wires = COUPLED["section 5"]
    plain = ours(peer_run(fmus, names, wires, 10_000_000, 200))
    for other in (
        ours(peer_run(fmus, names, wires, 10_000_000, 200, {"delay.d": 0.3 + 1e-6})),
        ours(peer_run(fmus, names, wires[1:], 10_000_000, 200)),
    ):
        with pytest.raises(AssertionError):
            assert_equal(other, plain)


def test_host_without_python_fails_as_the_check_reports(fmus: Path, tmp_path: Path) -> None:
    """An FMU that is reported to need a Python host ends a program that has none."""
    fmu = fmus / "WaveField.fmu"
    assert "needs-python" in [each.code for each in inspect_fmu(fmu).findings]
    assert ecos_program.simulate(fmu, 0.02, 1.0, tmp_path).code != 0


@pytest.mark.parametrize("flavour", [f for f in FLAVOURS if f != "python"])
@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_host_without_python_runs_native_fmus(tmp_path: Path, flavour: str, name: str) -> None:
    """A program in C++ gives the same figures, to the digits that it prints."""
    fmu = fmu_folder(flavour) / f"{name}.fmu"
    assert all(each.level == "note" for each in inspect_fmu(fmu).findings)
    done = ecos_program.simulate(fmu, 0.02, 1.0, tmp_path)
    assert done.code == 0, done.output
    (part,) = [n for n in PARTS if n != "sine" and PARTS[n][0] == name]
    plain = Part(str(fmu_folder("native") / f"{name}.fmu"), {})
    watch = tuple((part, output) for output in OUTPUTS[part])
    expected = ours(PeerRun({part: plain}, (), 20_000_000, 49, watch))
    for label_, row in expected.items():
        printed = done.table[label_.partition(".")[2]]
        assert np.abs(printed[1 : row.size + 1] - row).max() <= ecos_program.DIGITS + TOLERANCE
