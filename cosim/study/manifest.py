"""The provenance of a study's table: what its results come from and depend on."""

from __future__ import annotations

from typing import Any

from cosim.study.batch import software
from cosim.study.plan import Plan


def manifest_of(plan: Plan) -> dict[str, Any]:
    """Return JSON values; `digest` and `parts` are hashes of what the results depend on."""
    job = plan.job
    study = job.study.model_dump(mode="json", exclude_unset=True)
    return {
        "digest": job.digest,
        "parts": plan.hashes,
        "count": plan.runner.points.most,
        "study": study,
        "scenario": {"name": job.base.name, "text": job.base.text},
        "fmus": job.hashes,
        "flavour": job.base.flavour,
        "seeds": {"samples": job.study.seed, "run": job.base.scenario.run.seed},
        "versions": software(),
        "units": plan.units,
    }
