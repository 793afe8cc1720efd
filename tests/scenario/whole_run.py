"""What an outcome says of a run, from the whole arrays of its rows: a truth to compare.

Written as expressions over all points at once, where a run is measured block by block.
"""

from __future__ import annotations

import itertools
import math
from typing import Any, NamedTuple

import numpy as np

from cosim.master import Run, System, receiving_order
from cosim.models import DelaySystem
from cosim.network import PacketLink


class Ages(NamedTuple):
    """Ages of measurements in use [ns]; `in_use_ns` : least and greatest as one comes into use."""

    least_ns: int | None
    greatest_ns: int
    in_use_ns: tuple[int, int] | None
    first_ns: int
    alike: bool
    interrupted: bool


class Binding(NamedTuple):
    """Variables of a plant that are x, u and w; `thrust` : from u's variables to u."""

    state: tuple[str, ...]
    control: tuple[str, ...]
    disturbance: tuple[str, ...]
    thrust: Any = None


def measured_ages(run: Run, plant: str, controller: str, *, jacobi: bool = True) -> Ages | None:
    """Ages of measurements, by following every row back from the plant to the plant."""
    by_name = {s.name: s for s in run.instances}
    points, c = run.points_ns, by_name[controller]
    down = [r for r in by_name[plant].routes if r.source == controller]
    up = [r for r in c.routes if r.source == plant]
    if not (down and up) or points.size < 2:
        return None
    given, port = c.component.parameters, c.component.description.ports.get("sample_time")
    period = round(float(given.get("sample_time", (port.start if port else 0.0) or 0.0)) * 1e9)
    own = c.own_points.own[c.own_points.own < points.size].tolist()
    used = dict.fromkeys(range(points.size), -1)
    latest = -1
    for begin, end in itertools.pairwise(own):
        first, last = int(points[begin]), int(points[end])
        if period <= 0 or -(-first // period) * period < last:
            latest = begin
        used[end] = latest
    intervals: list[tuple[int, list[int]]] = []  # point, and when what is in use there was taken
    for k in range(points.size - 1):
        taken = []
        for back in down:
            ports = [c.output_columns[int(j) - c.output_column].port for j in back.columns]
            prompt = jacobi and all(p.feedthrough and p.feedthrough_declared for p in ports)
            command = int(back.in_step.row[k])
            read = -1 if command < 0 else command if prompt else used[command]
            for forth in up:
                row = -1 if read < 0 else int(forth.in_step.row[read])
                taken.append(-1 if row < 0 else int(points[row]))
        intervals.append((k, taken))
    known = [(k, taken) for k, taken in intervals if min(taken) >= 0]
    if not known:
        return None
    comes = [
        int(points[k]) - min(taken)
        for k, taken in known
        if min(taken) > 0 and (k == 0 or min(intervals[k - 1][1]) != min(taken))
    ]
    young = [int(points[k]) - max(taken) for k, taken in known if min(taken) > 0]
    return Ages(
        least_ns=min(young, default=None),
        greatest_ns=max(int(points[k + 1]) - min(taken) for k, taken in known),
        in_use_ns=(min(comes), max(comes)) if comes else None,
        first_ns=int(points[known[0][0]]),
        alike=all(min(taken) == max(taken) for _, taken in known),
        interrupted=len(known) < len(intervals) - known[0][0],
    )


def saturation_of(run: Run, controller: str, bounds: dict[str, float]) -> tuple[Any, ...] | None:
    """Fraction, largest commands, and whether it is a limit cycle."""
    points = run.points_ns
    if points.size < 2:
        return None
    commands = np.column_stack([run.signal(controller, n) for n in bounds])
    at_limit = (np.abs(commands) >= np.array([*bounds.values()]) * (1 - 1e-12))[:-1]
    duration = np.diff(points)
    late = points[:-1] >= points[-1] * 3 // 4
    share = duration[late & at_limit.any(axis=1)].sum() / max(duration[late].sum(), 1)
    turns = [
        np.count_nonzero(np.diff(np.sign(commands[:-1, j][late & at_limit[:, j]])))
        for j in range(len(bounds))
    ]
    return (
        float(duration[at_limit.any(axis=1)].sum()) / float(duration.sum()),
        {n: float(np.abs(commands[:, j]).max()) for j, n in enumerate(bounds)},
        run.status == "finished" and bool(share > 0.5 and max(turns) >= 4),
    )


def gain_of(run: Run, plant: str, binding: Binding, system: DelaySystem) -> float | None:
    """sqrt(int z'z / int w'w), every sum and product from the left."""
    instance = next(s for s in run.instances if s.name == plant)
    recorded = {c.name for c in (*instance.output_columns, *instance.input_columns)}
    ports = instance.component.description.ports

    def values(names: Any) -> list[Any]:
        return [
            run.signal(plant, n)
            if n in recorded
            else np.full(run.points_ns.size, instance.component.parameters.get(n, ports[n].start))
            for n in names
        ]

    def times(matrix: Any, columns: list[Any]) -> list[Any]:
        found = []
        for row in np.asarray(matrix).tolist():
            terms = [a * column for a, column in zip(row, columns, strict=True)]
            added = terms[0]
            for term in terms[1:]:
                added = added + term
            found.append(added)
        return found

    x, w = values(binding.state), values(binding.disturbance)
    u = values(binding.control)
    if binding.thrust is not None:
        u = times(binding.thrust, u)
    d1, d2 = times(system.D1, w), times(system.D2, u)
    direct = [a + b for a, b in zip(d1, d2, strict=True)]
    z = times(system.D, x)
    energy_in = energy_a = energy_b = 0.0
    for k, ns in enumerate(np.diff(run.points_ns).tolist()):
        h = ns / 1e9
        for column in w:
            energy_in += h * float(column[k]) * float(column[k])
        for one, added in zip(z, direct, strict=True):
            a, b = float(one[k]) + float(added[k]), float(one[k + 1]) + float(added[k])
            energy_a += h * a * a
            energy_b += h * b * b
    if run.status == "failed" or energy_in == 0.0:
        return None
    gain = math.sqrt(0.5 * (energy_a + energy_b) / energy_in)
    return gain if math.isfinite(gain) else None


def coupling_delays(run: Run, system: System) -> dict[str, float]:
    """By connection, from every step of its receiver."""
    found: dict[str, float] = {}
    points = run.points_ns
    by_name = {s.name: s for s in run.instances}
    for instance in run.instances if points.size > 1 else ():
        for route in instance.routes:
            key = route.route_key
            words = f"{key.source} -> {instance.name}" + (f" over {key.link}" if key.link else "")
            link = None if key.link is None else system.links[key.link]
            starts = instance.own_points.own[instance.own_points.own < points.size - 1]
            ends = points[np.minimum(instance.own_points.following[starts], points.size - 1)]
            if isinstance(link, PacketLink):
                sender = by_name[key.source]
                known = min(run.end_ns, run.deliveries[link.name].horizon_ns - 1)
                times, in_use = run.deliveries[link.name].changes(-1, known)
                later = key.policy == "previous"
                late = 0.0
                for s, end in zip(starts.tolist(), ends.tolist(), strict=True):
                    at = int(points[max(s - later, 0)])
                    until = [int(t) for t in times if t <= at]
                    later_ones = [int(t) for t in times if at < t < end]
                    old = 0
                    if until and in_use[len(until) - 1] >= 0:
                        row = int(np.searchsorted(points, in_use[len(until) - 1]))
                        old = int(points[row] - points[sender.own_points.last[row]])
                    late = max(late, old + (end - later_ones[0] if later_ones else 0))
            else:
                row = np.clip(route.in_step.row[starts], 0, points.size - 1)
                origin = points[row].astype(float)
                weight, after = route.in_step.weight, route.in_step.after
                if weight is not None and after is not None:
                    second = np.minimum(after[starts], points.size - 1)
                    origin += weight[starts] * (points[second] - points[row])
                due = ends if link is None else link.read_ns(ends)
                late = float((due - origin).max(initial=0.0))
            found[words] = max(late / 1e9, found.get(words, 0.0))
    return dict(sorted(found.items()))


def cut_delays(run: Run, system: System) -> dict[Any, float]:
    """By cut connection, the longest step that ends at a point of its receiver."""
    by_name = {s.name: s for s in run.instances}
    points, found = run.points_ns, {}
    for c in receiving_order(system).cut:
        own = by_name[c.target.component].own_points.own
        here = own[(own > 0) & (own < points.size)]
        last = by_name[c.source.component].own_points.last
        sent = last if c.link is None else np.arange(points.size)
        found[c] = float((points[sent[here]] - points[sent[here - 1]]).max(initial=0)) / 1e9
    return found


def verdict_of(
    part: Any, holds: list[bool], since: list[bool] | None, run: Run, end: float
) -> tuple[str, float | None]:
    """The result of an assertion and the point that decided it, from its truth at every point."""
    seconds = [int(t) / 1e9 for t in run.points_ns]
    after, before = part.after or 0.0, end if part.before is None else part.before
    inside = [k for k, t in enumerate(seconds) if after <= t <= before]
    last = seconds[-1] if seconds else -1.0
    whole = run.status == "finished" or last >= before
    rest = "undecided" if run.status == "stopped" else "fails"
    if part.within is None:
        wanted = part.always is None
        decided = [k for k in inside if holds[k] is wanted]
        if decided:
            return ("holds" if wanted else "fails"), seconds[decided[0]]
        return (("fails" if wanted else "holds") if whole else rest), None
    starts = inside[:1]
    if since is not None:
        starts = [k for k in inside if since[k] and not (k and since[k - 1])]
    undecided = False
    for k in starts:
        true_at = next(
            (t for t, true in zip(seconds, holds, strict=True) if true and t >= seconds[k]),
            math.inf,
        )
        if true_at > seconds[k] + part.within.of * (1 + 1e-12):
            if whole or seconds[k] + part.within.of <= last:
                return "fails", seconds[k]
            undecided = True
    return (rest if undecided else "holds"), None
