"""A design as JSON: its certificate, and the figures of the nominal loop."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from cosim.core import InputError, format_value
from cosim.hinf import nominal
from cosim.hinf.certificate import KEY, check_certificate, guarantees_from_json, system_from_json
from cosim.hinf.synthesis.certified_design import Design
from cosim.hinf.synthesis.certified_pair import OutputFeedback, output_feedback_from_json
from cosim.hinf.synthesis.kept_figures import (
    FIGURES,
    LATER_FIGURES,
    figures_from_json,
    figures_to_json,
    has_figures,
)
from cosim.models import DelaySystem


def design_to_json(design: Design | OutputFeedback) -> dict[str, Any]:
    """Return JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`."""
    if isinstance(design, OutputFeedback):
        return design.to_json()
    return {**design.certificate, "figures": figures_to_json(design)}


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
    if not has_figures(figures):
        if "kind" in data:
            raise InputError("not a design", where=where, got="an analysis, without figures")
        raise InputError(
            "this design has not the figures of a design",
            where=where,
            expected=f"figures: {', '.join(FIGURES)}, optionally {', '.join(LATER_FIGURES)}",
            got=format_value(sorted(figures) if isinstance(figures, dict) else figures),
        )
    system = system_from_json(data["system"])
    return _design(data, system, *figures_from_json(figures, where, system, np.array(data["K"])))


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
    system = system_from_json(data["system"])
    return _design(data, system, None, nominal.figures_if_known(system, K)[0])


def _observes(data: Any) -> bool:
    return isinstance(data, dict) and data.get("kind") == "output-feedback"


def _require_proof(data: Any, where: str) -> None:
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)


def _kind_of(data: Any) -> str:
    return f"a certificate of kind {data['kind']}" if "kind" in data else "no gain K"


def _design(
    data: Any, system: DelaySystem, least: float | None, figures: nominal.NominalFigures
) -> Design:
    """Return the design of a certificate whose proof holds, with these figures."""
    # the claimed values are read from the proof, never from a note beside it
    proved = data["variables"]
    K = np.array(data["K"], dtype=float)
    order: int | None = proved.get("order")
    keys = ("kind", "theorem", "claim", "system", "variables", "K", KEY)
    return Design(
        system=system,
        K=K,
        gamma=None if proved["gamma"] is None else _double(proved["gamma"]),
        k1=() if order is not None else tuple(map(_double, proved["k1"])),
        k2=() if order is not None else tuple(map(_double, proved["k2"])),
        certificate={key: data[key] for key in keys if key in data},
        order=order,
        guarantees=guarantees_from_json(data, system, K),
        least_gamma=least,
        figures=figures,
    )


def _double(text: str) -> float:
    return float(Fraction(text))
