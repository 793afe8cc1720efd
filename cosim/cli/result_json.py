"""What is certified of a loop as JSON: what `design`, `analyse` and `certificate prove` print."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim import hinf
from cosim.cli.result_view import peaks_of
from cosim.models import DelaySystem


def result_json(
    name: str,
    result: hinf.Result,
    save: Path | None,
    greatest: hinf.GreatestDelay | None = None,
    nominal: float | None = None,
) -> dict[str, Any]:
    """Return the object that `--json` prints; null where nothing was asked for, found or proved.

    save : file of the certificate.
    nominal : gamma without uncertainty, if it was computed.
    """
    price = None if result.gamma is None or nominal is None else result.gamma - nominal
    delays: list[float | None] = [delay.d for delay in result.system.delays]
    if greatest is not None:
        delays[greatest.delay_index] = greatest.delay
    margins, norm = result.delay_margin, result.exact_norm
    proof = result.certificate
    return {
        "system": name,
        "gamma": result.gamma,
        "delays": delays,
        "K": result.K.tolist() if result.K.any() else None,
        "k1": list(result.k1) or None,
        "k2": list(result.k2) or None,
        "order": result.order,
        "up_to_delays": None if proof is None else result.covers_smaller_delays,
        "certified": result.certified,
        "verdict": result.verdict,
        "reason": result.reason,
        "certificate": None if save is None else str(save),
        "constant_ages_claimed": None
        if proof is None
        else hinf.certificate.constant_ages_claimed(proof),
        **_guarantees(result.guarantees),
        "damping_reason": result.damping_reason,
        "limit_reached": None if greatest is None else greatest.limit_reached,
        "not_certified_at": None if greatest is None else greatest.not_certified_at,
        "refuted_at": None if greatest is None else greatest.refuted_at,
        "terms": _terms(result.system),
        "least_gamma": result.least_gamma,
        "gamma_nominal": nominal,
        "paid_for_uncertainty": price,
        "exact_norm": norm,
        "exact_norm_upper": result.exact_norm_upper,
        "norm_frequency": result.norm_frequency,
        "gamma_over_exact_norm": result.gamma / norm if result.gamma is not None and norm else None,
        "abscissa": result.abscissa,
        "delay_margin": None if margins is None else list(margins),
        **_observer(result),
    }


def _guarantees(more: hinf.certificate.Guarantees) -> dict[str, Any]:
    """Return what is proved beside gamma; null for what is not."""
    peak, damping = more.peak_control, more.damping
    return {
        "decay": None if more.decay is None else float(more.decay.rate),
        "damping": None if damping is None else float(damping.ratio),
        "within": None if damping is None else float(damping.within),
        "outages": outages_json(more.outages),
        "gain_limit": None if more.gain_limit is None else float(more.gain_limit.bound),
        "peak_control": None if peak is None else [float(x) for x in peak.bounds],
        "offset": None if peak is None else [float(x) for x in peak.offset],
        "energy": None if peak is None else float(peak.energy),
    }


def outages_json(outages: hinf.certificate.Outages | None) -> dict[str, Any] | None:
    """Return what is proved across outages; None where nothing is."""
    if outages is None:
        return None
    return {
        "alpha": float(outages.alpha),
        "beta": float(outages.beta),
        "share_needed": float(outages.share),
        "gamma": None if outages.gamma is None else float(outages.gamma),
        "fallback": outages.fallback.tolist(),
        "fallback_age": outages.fallback_age,
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


def _observer(result: hinf.Result) -> dict[str, Any]:
    """Return what an observer is and knows; nothing where the state is fed back."""
    pair = result.observer
    if pair is None:
        return {}
    return {
        "kind": "output-feedback",
        "L": {x.name: rows.tolist() for x, rows in zip(pair.measurements, pair.L, strict=True)},
        "measurements": result.certificate["measurements"],
        "known_states": result.certificate["claim"]["observer"]["known_states"],
        "command_age": pair.command_age,
        "command_any_age": pair.command_any_age,
        "peaks": peaks_of(result),
    }
