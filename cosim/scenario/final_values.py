"""The outputs of all components at the last point of a run."""

from __future__ import annotations

from cosim.scenario.measure import Fold, MeasuredRun, measure


@measure
def last_outputs(run: MeasuredRun) -> Fold[dict[str, dict[str, float]]]:
    """Measure component -> output -> value at the last point reached; empty without a point."""
    while (yield):
        pass
    outputs = {}
    for name, instance in run.instances.items() if run.end.count else ():
        row = instance.outputs[instance.own_points.last[run.end.count - 1]].tolist()
        outputs[name] = {c.name: v for c, v in zip(instance.output_columns, row, strict=True)}
    return outputs
