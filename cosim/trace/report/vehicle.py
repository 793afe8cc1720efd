"""Chart a vehicle: path, pose against reference, speeds, thrust with limits, disturbance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.page import packed_values
from cosim.trace.report.chart import Chart, curve_of
from cosim.trace.report.decimation import decimated
from cosim.trace.report.parameters import Settings
from cosim.trace.report.series import DrawnSeries, Reals, Recording

_POSE = ("eta.x", "eta.y", "eta.z", "eta.psi")
_TITLES = {
    "eta.x": "North x",
    "eta.y": "East y",
    "eta.z": "Depth z",
    "eta.psi": "Heading ψ",
    "force.x": "Surge force",
    "force.y": "Sway force",
    "force.z": "Heave force",
    "moment.z": "Yaw moment",
}
_COMMANDS = ("force.x", "force.y", "force.z", "moment.z")
_HEADINGS = 24
_PATH_SEGMENTS = 600


@dataclass(frozen=True)
class Vehicle:
    """The component that is a vehicle, and the one that steers it.

    Attributes
    ----------
    name : of the vehicle's component.
    pose : its outputs eta.x, eta.y, eta.z, eta.psi.
    steering : the component with references for the pose, None if there is none.
    reference : its inputs reference.x, ..., by the output of `pose` that they are for.
    """

    name: str
    pose: Mapping[str, DrawnSeries]
    steering: str | None
    reference: Mapping[str, DrawnSeries]


def vehicle_of(recording: Recording) -> Vehicle | None:
    """Return the first component that sends a pose; None if there is none."""
    senders = dict.fromkeys(s.component for s in recording.series if s.direction == "output")
    for name in senders:
        outputs = recording.of(name, "output")
        if not all(axis in outputs for axis in _POSE):
            continue
        pose = {axis: outputs[axis] for axis in _POSE}
        for other in dict.fromkeys(s.component for s in recording.series):
            received = recording.of(other, "input")
            references = {axis: axis.replace("eta.", "reference.") for axis in _POSE}
            wanted = {axis: received[n] for axis, n in references.items() if n in received}
            if wanted:
                return Vehicle(name, pose, other, wanted)
        return Vehicle(name, pose, None, {})
    return None


def charts_of(vehicle: Vehicle, recording: Recording, settings: Settings) -> Iterator[Chart]:
    """Yield the charts of a vehicle over time."""
    measured = recording.of(vehicle.steering, "input") if vehicle.steering else {}
    for axis, true in vehicle.pose.items():
        curves = [curve_of(true, 0, "true")]
        if axis in measured:
            curves.append(curve_of(measured[axis], 1, "as received", hidden=True))
        if axis in vehicle.reference:
            curves.append(curve_of(vehicle.reference[axis], "reference", "reference"))
        yield Chart(f"{vehicle.name}-{axis}", _TITLES[axis], true.unit or "", curves)
    yield from _speeds(vehicle, recording)
    received = recording.of(vehicle.name, "input")
    commanded = recording.of(vehicle.steering, "output") if vehicle.steering else {}
    for name in _COMMANDS:
        curves = []
        if name in received:
            curves.append(curve_of(received[name], 0, "at the vehicle"))
        if name in commanded:
            curves.append(curve_of(commanded[name], 1, "commanded", hidden=name in received))
        if not curves:
            continue
        unit = next((curve.unit for curve in curves if curve.unit), "")
        chart = Chart(f"{vehicle.name}-{name}", _TITLES[name], unit, curves)
        bound = settings.limit(vehicle.steering, name) if vehicle.steering else None
        if bound is not None:
            _bound(chart, bound)
        yield chart
    yield from _disturbances(vehicle, received)


def _bound(chart: Chart, bound: float) -> None:
    """Draw the limit, or note it where it is so far above all values that curves would be flat."""
    most = max(float(np.nanmax(np.abs(c.values), initial=0.0)) for c in chart.curves)
    if most >= 0.25 * bound:
        chart.bounds = [("limit", bound), ("limit (negative)", -bound)]
    else:
        chart.note = f"limit ±{bound:g} {chart.unit}: at most {most / bound:.1%} of it is used"


def _speeds(vehicle: Vehicle, recording: Recording) -> Iterator[Chart]:
    outputs = recording.of(vehicle.name, "output")
    linear = [outputs[n] for n in ("nu.u", "nu.v", "nu.w") if n in outputs]
    if linear:
        labels = ("surge u", "sway v", "heave w")
        curves = [curve_of(s, i, labels[i]) for i, s in enumerate(linear)]
        yield Chart(f"{vehicle.name}-nu", "Speeds", linear[0].unit or "", curves)
    if "nu.r" in outputs:
        curve = curve_of(outputs["nu.r"], 0, "yaw rate r")
        yield Chart(f"{vehicle.name}-nu.r", "Yaw rate", curve.unit, [curve])


def _disturbances(vehicle: Vehicle, received: Mapping[str, DrawnSeries]) -> Iterator[Chart]:
    by_unit: dict[str, list[DrawnSeries]] = {}
    for name, series in received.items():
        if name.startswith("disturbance."):
            by_unit.setdefault(series.unit or "", []).append(series)
    for unit, disturbances in by_unit.items():
        curves = [curve_of(s, i, s.name) for i, s in enumerate(disturbances)]
        yield Chart(f"{vehicle.name}-disturbance-{unit}", "Disturbance", unit, curves)


def drawn(vehicle: Vehicle) -> set[str]:
    """Return the signals ("/topic name") that `charts_of` shows, not to be shown twice."""
    names = {f"/{vehicle.name}/output {name}" for name in (*_POSE, "nu.u", "nu.v", "nu.w", "nu.r")}
    names |= {f"/{vehicle.name}/input {name}" for name in _COMMANDS}
    names |= {f"/{vehicle.name}/input disturbance.{axis}" for axis in "uvwr"}
    if vehicle.steering:
        names |= {f"/{vehicle.steering}/output {name}" for name in _COMMANDS}
        names |= {f"/{vehicle.steering}/input {name}" for name in _POSE}
        names |= {f"/{vehicle.steering}/input {s.name}" for s in vehicle.reference.values()}
    return names


def path_of(vehicle: Vehicle) -> dict[str, Any]:
    """Return the path for the plan view and the 3-D view, thinned so that its corners survive.

    Keys: `t`, `x`, `y`, `z`, `psi` (packed); `reference` with all but `psi`, None without one;
    `headings` [[x, y, z, psi, t], ...], `start` and `end` [x, y, z], `target` [x, y, z] or None.
    """
    t = vehicle.pose["eta.x"].t
    place = [vehicle.pose[axis].values for axis in ("eta.x", "eta.y", "eta.z")]
    finite = np.all(np.isfinite(place), axis=0)
    if not finite.any():
        return {}
    psi, times = vehicle.pose["eta.psi"].values[finite], t[finite]
    kept = _kept(times, [*(axis[finite] for axis in place), psi])
    good = [axis[finite][kept] for axis in place]
    at = np.unique(np.searchsorted(times, np.linspace(times[0], times[-1], _HEADINGS)))
    at = at[at < times.size]
    rows = np.column_stack([*(axis[finite][at] for axis in place), psi[at], times[at]])
    reference, target = _reference(vehicle)
    return {
        **_axes(times[kept], good),
        "psi": packed_values(psi[kept]),
        "reference": reference,
        "headings": _numbers(rows[np.isfinite(rows).all(axis=1)]),
        "start": _numbers(np.array([axis[finite][0] for axis in place])),
        "end": _numbers(np.array([axis[finite][-1] for axis in place])),
        "target": target,
    }


def _reference(vehicle: Vehicle) -> tuple[dict[str, Any] | None, list[float] | None]:
    axes = ("eta.x", "eta.y", "eta.z")
    given = [vehicle.reference.get(axis) for axis in axes]
    first = next((s for s in given if s is not None), None)
    if first is None or vehicle.reference.get("eta.x") is None:
        return None, None
    values = [np.zeros(first.t.size) if s is None else s.values for s in given]
    finite = np.all(np.isfinite(values), axis=0)
    if not finite.any():
        return None, None
    kept = _kept(first.t[finite], [v[finite] for v in values])
    last = np.array([v[finite][-1] for v in values])
    return _axes(first.t[finite][kept], [v[finite][kept] for v in values]), _numbers(last)


def _kept(t: Reals, axes: list[Reals]) -> Any:
    return np.unique(np.concatenate([decimated(t, axis, _PATH_SEGMENTS // 3) for axis in axes]))


def _axes(t: Reals, axes: list[Reals]) -> dict[str, Any]:
    named = zip(("t", "x", "y", "z"), (t, *axes), strict=True)
    return {name: packed_values(values) for name, values in named}


def _numbers(values: Reals) -> Any:
    return np.round(np.clip(values, -1e150, 1e150), 9).tolist()
