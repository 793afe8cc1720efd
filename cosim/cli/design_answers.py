"""JSON output of `cosim design` and `cosim analyse`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim import hinf
from cosim.models import DelaySystem


def design_json(
    name: str,
    found: hinf.Design,
    greatest: hinf.GreatestDelay | None,
    save: Path | None,
    refutation: Path | None = None,
    nominal: float | None = None,
    weights: tuple[float, ...] | None = None,
) -> dict[str, Any]:
    """Return the object that `cosim design --json` prints.

    save, refutation : files of the certificate, and of the proof that no solution exists.
    nominal : gamma without uncertainty, if it was computed.
    weights : weights of the rows of z, if there are any.
    """
    more = found.guarantees
    peak = more.peak_control
    price = None if found.gamma is None or nominal is None else found.gamma - nominal
    return {
        "system": name,
        "gamma": found.gamma,
        "delays": [delay.d for delay in found.system.delays],
        "K": found.K.tolist(),
        "k1": list(found.k1) if found.order is None else None,
        "k2": list(found.k2) if found.order is None else None,
        "order": found.order,
        "up_to_delays": found.covers_smaller_delays,
        "certified": found.certified,
        "certificate": None if save is None else str(save),
        "constant_ages_claimed": hinf.certificate.constant_ages_claimed(found.certificate),
        "decay": None if more.decay is None else float(more.decay.rate),
        **_damping(found),
        "outages": outages_json(found.guarantees.outages),
        "gain_limit": None if more.gain_limit is None else float(more.gain_limit.bound),
        "peak_control": None if peak is None else [float(x) for x in peak.bounds],
        "offset": None if peak is None else [float(x) for x in peak.offset],
        "energy": None if peak is None else float(peak.energy),
        "weights": None if weights is None else list(weights),
        "limit_reached": None if greatest is None else greatest.limit_reached,
        "refuted_at": None if greatest is None else greatest.refuted_at,
        "refutation": None if refutation is None else str(refutation),
        "terms": _terms(found.system),
        "least_gamma": found.least_gamma,
        "gamma_nominal": nominal,
        "paid_for_uncertainty": price,
        **_nominal_figures(found),
    }


def analysis_json(
    name: str,
    found: hinf.Analysis,
    greatest: hinf.synthesis.CertifiedDelay | None,
    save: Path | None,
) -> dict[str, Any]:
    """Return the object that `cosim analyse --json` prints; `save`: file of the certificate."""
    delays: list[float | None] = [delay.d for delay in found.system.delays]
    if greatest is not None:
        delays[greatest.delay_index] = greatest.d
    return {
        "system": name,
        "gamma": found.gamma,
        "delays": delays,
        "K": None if found.K is None else found.K.tolist(),
        "k1": None,
        "k2": None,
        "certified": found.certified,
        "verdict": found.verdict,
        "reason": found.reason,
        "certificate": None if save is None else str(save),
        "order": found.order,
        "up_to_delays": found.covers_smaller_delays if found.certified else None,
        "limit_reached": None if greatest is None else greatest.limit_reached,
        "not_certified_at": None if greatest is None else greatest.not_certified_at,
        "terms": _terms(found.system),
        "least_gamma": found.least_gamma,
        **_damping(found),
        "outages": outages_json(found.guarantees.outages),
        "damping_reason": found.damping_reason,
        **_nominal_figures(found),
    }


def _damping(found: hinf.Design | hinf.Analysis) -> dict[str, Any]:
    """Return the damping ratio that is proved, and for which roots; None without one."""
    proved = found.guarantees.damping
    return {
        "damping": None if proved is None else float(proved.ratio),
        "within": None if proved is None else float(proved.within),
    }


def _terms(system: DelaySystem) -> list[dict[str, Any]]:
    """Return what each delay is; least_age, rate and sampled where they are known of an age."""
    return [
        {"feedback": x.feedback, "any_age": x.any_age}
        | ({"least_age": x.least_age} if x.ages_are_known else {})
        | ({"rate": x.rate} if x.rate is not None else {})
        | ({"sampled": True} if x.sampled else {})
        for x in system.delays
    ]


def _nominal_figures(found: hinf.Design | hinf.Analysis) -> dict[str, Any]:
    """Return the figures of the nominal loop, and the ratio of gamma to its exact norm."""
    margins, norm = found.delay_margin, found.exact_norm
    ratio = found.gamma / norm if found.gamma is not None and norm else None
    return {
        "exact_norm": norm,
        "exact_norm_upper": found.exact_norm_upper,
        "norm_frequency": found.norm_frequency,
        "gamma_over_exact_norm": ratio,
        "abscissa": found.abscissa,
        "delay_margin": None if margins is None else list(margins),
    }


def outages_json(found: hinf.certificate.Outages | None) -> dict[str, Any] | None:
    """Return what is proved across outages; None where nothing is."""
    if found is None:
        return None
    return {
        "alpha": float(found.alpha),
        "beta": float(found.beta),
        "share_needed": float(found.share),
        "gamma": None if found.gamma is None else float(found.gamma),
        "fallback": found.fallback.tolist(),
        "fallback_age": found.fallback_age,
    }
