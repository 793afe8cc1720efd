"""The delay at which a loop loses stability: measured, exact, and certified.

Measured: on the grid of a study, per loss, between the last delay up to which every run was stable
and the next. Exact: the delay margin of the nominal loop, from its characteristic equation.
Certified: the largest age of measurements that the proof covers.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from cosim.core import CosimError
from cosim.hinf import Delay, DelaySystem, delay_margin
from cosim.scenario import certified_age
from cosim.study.consistency import certified_metric
from cosim.study.plan import Plan
from cosim.study.schema import StabilityPart, Study


@dataclass(frozen=True)
class Edge:
    """The measured boundary at one loss.

    stable_to : the last delay up to which all runs were stable; None if there is none.
    unstable_from : the next delay; None if all runs were stable.
    certified_to : the last delay up to which every run met the assumptions of its certificate;
        None if there is none, or no metric `certified`.
    """

    loss: float | None
    stable_to: float | None
    unstable_from: float | None
    certified_to: float | None


@dataclass(frozen=True)
class Boundary:
    """The boundaries that the picture shows.

    exact_margin : None if the nominal loop is stable for every delay, or it is not known.
    certified_age : None if nothing is certified.
    agrees : whether, without loss, the exact margin lies between the last stable delay and the
        first unstable one; None if either is not known.
    certified_inside : whether every certified run was also measured as stable.
    """

    edges: tuple[Edge, ...]
    exact_margin: float | None
    certified_age: float | None
    agrees: bool | None
    certified_inside: bool | None

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return asdict(self)


def nominal_loop_figures(plan: Plan) -> dict[str, float | None] | None:
    """Return what is known of the nominal loop; None if the design changes from run to run.

    The proof and the margin are those of the first run's design.
    """
    study = plan.job.study
    moved = [place for axis in study.vary for place in axis.places]
    if study.stability is None or any(place.startswith("design") for place in moved):
        return None
    try:
        problem, design = plan.runner.problem_and_design(0)
    except CosimError:
        return None
    if problem is None or design is None:
        return None
    return {
        "exact_margin": loop_delay_margin(problem.system, design.K),
        "certified_age": certified_age(design),
        "gamma": design.gamma,
    }


def loop_delay_margin(system: DelaySystem, K: Any) -> float | None:
    """Return the delay of the feedback at which the nominal loop loses stability [s].

    A system without feedback delay is given one. None: stable for every delay.
    """
    for i, delay in enumerate(system.delays):
        if delay.feedback:
            return delay_margin(_at_zero(system, i), K)[i]
    late = Delay(0.0, np.zeros_like(system.A), feedback=True)
    return delay_margin(_with(system, (*system.delays, late)), K)[-1]


def _at_zero(system: DelaySystem, delay_index: int) -> DelaySystem:
    """Return the system without feedback delay, where the search for the margin starts."""
    delays = list(system.delays)
    late = delays[delay_index]
    delays[delay_index] = Delay(0.0, late.A, feedback=late.feedback)
    return _with(system, tuple(delays))


def _with(system: DelaySystem, delays: tuple[Delay, ...]) -> DelaySystem:
    # the nominal loop has no uncertainty
    plain = tuple(Delay(d.d, d.A, feedback=d.feedback) for d in delays)
    return DelaySystem(system.A, system.B, delays=plain, name=system.name, feedback=system.feedback)


def boundary(table: Any, manifest: dict[str, Any]) -> Boundary | None:
    """Return the stability boundary in a table of results; None for a study without [stability].

        >>> from cosim import Delay, DelaySystem, Scenario, run_study
        >>> from cosim.study import Study, boundary, read_table
        >>> loop = DelaySystem([[0]], delays=[Delay(1.0, [[-1]])])  # x' = -x(t - d)
        >>> flight = Scenario(step=0.1, until=20).add("loop", loop, initial=[1]).loaded()
        >>> d = {"kind": "grid", "name": "d", "path": "components.loop.parameters.delay.d"}
        >>> calm = {"signal": "loop.x[1]", "reduce": "growth_rate", "after": 5, "below": 0}
        >>> study = Study(title="Delays", scenario="loop", vary=[d | {"values": [1.0, 1.5, 2.0]}],
        ...               metrics={"calm": calm}, stability={"delay": "d", "stable": "calm"})
        >>> done = run_study(study, "delays", scenario=flight)
        >>> edge = boundary(*read_table("delays")).edges[0]  # the exact margin is pi / 2
        >>> edge.stable_to, edge.unstable_from
        (1.5, 2.0)

    table, manifest : of a study that is finished (`read_table`).
    """
    study = Study.model_validate(manifest["study"])
    part = study.stability
    if part is None:
        return None
    frame = table.to_pandas()
    known = manifest.get("stability") or {}
    certified = certified_metric(study)
    losses = [None] if part.loss is None else sorted(frame[part.loss].unique().tolist())
    edges = tuple(
        _edge(frame if loss is None else frame[frame[part.loss] == loss], part, loss, certified)
        for loss in losses
    )
    margin, first = known.get("exact_margin"), edges[0]
    lossless = first.loss in (None, 0.0)
    agrees = None
    if margin is not None and lossless and first.stable_to is not None:
        agrees = first.stable_to <= margin and (
            first.unstable_from is None or margin <= first.unstable_from
        )
    inside = None
    if certified is not None:
        kept = frame[frame[certified] == True]  # noqa: E712 - missing values are not True
        inside = bool((kept[part.stable] == True).all()) if len(kept) else None  # noqa: E712
    return Boundary(edges, margin, known.get("certified_age"), agrees, inside)


def _edge(frame: Any, part: StabilityPart, loss: float | None, certified: str | None) -> Edge:
    stable_to = unstable_from = certified_to = None
    certified_yet = certified is not None
    for delay, runs in frame.groupby(part.delay, sort=True):
        if unstable_from is None:
            if bool((runs[part.stable] == True).all()):  # noqa: E712 - missing is not True
                stable_to = float(delay)
            else:
                unstable_from = float(delay)
        certified_yet = certified_yet and bool((runs[certified] == True).all())  # noqa: E712
        if certified_yet:
            certified_to = float(delay)
    return Edge(loss, stable_to, unstable_from, certified_to)
