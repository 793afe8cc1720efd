"""A design as JSON: its certificate, and the figures of the nominal loop."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import asdict, replace
from fractions import Fraction
from typing import Any

import numpy as np

from cosim.core import InputError, NotAchievableError
from cosim.hinf import nominal
from cosim.hinf.certificate import (
    KEY,
    check_certificate,
    format_value,
    guarantees_from_json,
    number,
    system_from_json,
)
from cosim.hinf.synthesis.certified_design import Design
from cosim.hinf.synthesis.certified_pair import OutputFeedback, output_feedback_from_json

# computed, not part of the claim
_FIGURES = ("least_gamma", "abscissa", "exact_norm", "norm_frequency")
# absent in older files: then None
_LATER_FIGURES = ("exact_norm_upper", "delay_margin", "worst_case")


def design_to_json(design: Design | OutputFeedback) -> dict[str, Any]:
    """Return JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`."""
    if isinstance(design, OutputFeedback):
        return design.to_json()
    figures = {name: getattr(design, name) for name in (*_FIGURES, "exact_norm_upper")}
    margin = design.delay_margin
    figures["delay_margin"] = None if margin is None else list(margin)
    if design.worst_case is not None:  # else left out: a design that is read is written as it was
        figures["worst_case"] = {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(design.worst_case).items()
        }
    return {**design.certificate, "figures": figures}


def design_from_json(data: Any, *, where: str) -> Design | OutputFeedback:
    """Read a design from its JSON, and check its proof again.

    One of kind "output-feedback" is an `OutputFeedback`.

    Raises
    ------
    InputError : not a design, or one whose proof does not hold.
    """
    if _observes(data):
        return output_feedback_from_json(data, where=where)
    _require_proof(data, where)
    figures = data.get("figures")
    known = set(_FIGURES + _LATER_FIGURES)
    if not isinstance(figures, dict) or not set(_FIGURES) <= set(figures) <= known:
        if "kind" in data:
            raise InputError("not a design", where=where, got="an analysis, without figures")
        raise InputError(
            "this design has not the figures of a design",
            where=where,
            expected=f"figures: {', '.join(_FIGURES)}, optionally {', '.join(_LATER_FIGURES)}",
            got=format_value(sorted(figures) if isinstance(figures, dict) else figures),
        )
    return _design(data, figures, where)


def design_from_certificate(data: Any, *, where: str) -> Design | OutputFeedback:
    """Read a design from its certificate alone, as a controller FMU carries it.

    The figures of the nominal loop, which no claim depends on, are computed.

    Raises
    ------
    InputError : a proof that does not hold, or that is not about a gain.
    """
    if _observes(data):
        return output_feedback_from_json(data, where=where)
    _require_proof(data, where)
    K, variables = data.get("K"), data.get("variables")
    if not K or not K[0] or not isinstance(variables, dict) or "gamma" not in variables:
        raise InputError(
            "not a design", where=where, expected="the proof of a gain", got=_kind_of(data)
        )
    system, found = system_from_json(data["system"]), None
    with suppress(NotAchievableError, np.linalg.LinAlgError), np.errstate(all="ignore"):
        found = nominal.nominal_figures_of(system, K)
    if found is None:
        return _design(data, {}, where)
    margin = found.delay_margin
    figures = found._asdict() | {"delay_margin": None if margin is None else list(margin)}
    worst = nominal.worst_case_at(system, np.array(K), found.norm_frequency)
    return replace(_design(data, figures, where), worst_case=worst)


def _observes(data: Any) -> bool:
    return isinstance(data, dict) and data.get("kind") == "output-feedback"


def _require_proof(data: Any, where: str) -> None:
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)


def _kind_of(data: Any) -> str:
    return f"a certificate of kind {data['kind']}" if "kind" in data else "no gain K"


def _design(data: Any, figures: dict[str, Any], where: str) -> Design:
    """Return the design of a certificate whose proof holds, with these figures."""
    # the claimed values are read from the proof, never from a note beside it
    proved = data["variables"]
    system = system_from_json(data["system"])
    notes: dict[str, Any] = {
        name: _number_or_none(figures.get(name), f"{where}: {name}")
        for name in (*_FIGURES, "exact_norm_upper")
    }
    margins = figures.get("delay_margin")
    if margins is not None:
        margins = _margins(margins, f"{where}: delay_margin", len(system.delays))
    worst = figures.get("worst_case")
    if worst is not None:
        worst = nominal.worst_case_from_json(worst, f"{where}: worst_case", system.C.shape[1])
    order: int | None = proved.get("order")
    own = ("kind", "theorem", "claim", "system", "variables", "K", KEY)
    return Design(
        system=system,
        K=np.array(data["K"], dtype=float),
        gamma=None if proved["gamma"] is None else _double(proved["gamma"]),
        k1=() if order is not None else tuple(map(_double, proved["k1"])),
        k2=() if order is not None else tuple(map(_double, proved["k2"])),
        certificate={key: data[key] for key in own if key in data},
        order=order,
        guarantees=guarantees_from_json(data, system),
        delay_margin=margins,
        worst_case=worst,
        **notes,
    )


def _number_or_none(value: Any, where: str) -> float | None:
    return None if value is None else number(value, where)


def _margins(values: Any, where: str, N: int) -> tuple[float | None, ...]:
    if not isinstance(values, list) or len(values) != N:
        raise InputError(
            "not a delay margin",
            where=where,
            expected=f"a list of {N}, one number or null per delay",
            got=format_value(values),
        )
    return tuple(_number_or_none(value, f"{where}[{i}]") for i, value in enumerate(values))


def _double(text: str) -> float:
    return float(Fraction(text))
