"""Designs and analyses as the JSON that the command line prints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim.hinf import Analysis, CertifiedDelay, Design, GreatestDelay


def design_json(
    name: str,
    found: Design,
    reach: GreatestDelay | None,
    save: Path | None,
    refutation: Path | None,
) -> dict[str, Any]:
    """What `cosim design --json` prints.

    save, refutation : where the certificate is, and that of what cannot be had.
    """
    return {
        "system": name,
        "gamma": found.gamma,
        "delays": [delay.d for delay in found.system.delays],
        "K": found.K.tolist(),
        "k1": list(found.k1),
        "k2": list(found.k2),
        "certified": found.certified,
        "certificate": None if save is None else str(save),
        "limit_reached": None if reach is None else reach.limit_reached,
        "refuted_at": None if reach is None else reach.refuted_at,
        "refutation": None if refutation is None else str(refutation),
        "terms": [{"feedback": d.feedback, "any_age": d.any_age} for d in found.system.delays],
        "least_gamma": found.least_gamma,
        "exact_norm": found.exact_norm,
        "norm_frequency": found.norm_frequency,
        "abscissa": found.abscissa,
    }


def analysis_json(
    name: str, found: Analysis, reach: CertifiedDelay | None, save: Path | None
) -> dict[str, Any]:
    """What `cosim analyse --json` prints; `save`: where the certificate is, if there is one."""
    delays: list[float | None] = [delay.d for delay in found.system.delays]
    if reach is not None:
        delays[reach.which] = reach.d
    return {
        "system": name,
        "gamma": found.gamma,
        "delays": delays,
        "K": None if found.K is None else found.K.tolist(),
        "k1": None,
        "k2": None,
        "certified": found.certified,
        "reason": found.reason,
        "certificate": None if save is None else str(save),
        "order": found.order,
        "up_to_delays": found.up_to if found.certified else None,
        "limit_reached": None if reach is None else reach.limit_reached,
        "not_certified_at": None if reach is None else reach.not_beyond,
        "terms": [{"feedback": d.feedback, "any_age": d.any_age} for d in found.system.delays],
        "least_gamma": found.least_gamma,
        "exact_norm": found.exact_norm,
        "norm_frequency": found.norm_frequency,
        "abscissa": found.abscissa,
    }
