"""A result as JSON: its certificate, and the figures of the nominal loop beside it.

The figures are computed and no part of the claim; what is read is what was computed once, so that
no solver, and no processor, decides on the digits of a later run.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from cosim.core import InputError, format_value
from cosim.hinf import delay_lti
from cosim.hinf.certificate import (
    KEY,
    check_certificate,
    number,
)
from cosim.hinf.delay_lti import NominalFigures
from cosim.hinf.synthesis.result import Result, proved_facts
from cosim.models import DelaySystem, Matrix

FIGURES = ("least_gamma", "abscissa", "exact_norm", "norm_frequency")
LATER_FIGURES = ("exact_norm_upper", "delay_margin", "worst_case")
"""Absent in older files: then None."""
_OF_A_GAIN = ("kind", "theorem", "claim", "system", "variables", "K", KEY)
"""What is kept of a file about a gain: its proof, and no note beside it."""


def design_to_json(design: Result) -> dict[str, Any]:
    """Return JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`."""
    return {**design.certificate, "figures": _figures_to_json(design)}


def design_from_json(data: Any, *, where: str) -> Result:
    """Read a design from its JSON, and check its proof again.

    Raises
    ------
    InputError : not a design, or one whose proof does not hold.
    """
    observes = _observes(data)
    _require_proof(data, where)
    figures = data.get("figures")
    if not observes and not _has_figures(figures):
        if "kind" in data:
            raise InputError("not a design", where=where, got="an analysis, without figures")
        raise InputError(
            "this design has not the figures of a design",
            where=where,
            expected=f"figures: {', '.join(FIGURES)}, optionally {', '.join(LATER_FIGURES)}",
            got=format_value(sorted(figures) if isinstance(figures, dict) else figures),
        )
    if observes and not (_has_figures(figures) and "delay_margin" in figures):
        return design_from_certificate(data, where=where)  # older files have not all of them
    facts = proved_facts(data)
    least, kept = _figures_from_json(figures, where, *_loop_of(facts))
    return Result(**facts, figures=kept, certificate=_kept(data), least_gamma=least)


def design_from_certificate(data: Any, *, where: str) -> Result:
    """Read a design from its certificate alone, as a controller FMU carries it.

    The figures of the nominal loop, which no claim depends on, are computed.

    Raises
    ------
    InputError : a proof that does not hold, or that is not about a gain.
    """
    _require_proof(data, where)
    K, variables = data.get("K"), data.get("variables")
    if not _observes(data) and (
        not K or not K[0] or not isinstance(variables, dict) or "gamma" not in variables
    ):
        got = f"a certificate of kind {data['kind']}" if "kind" in data else "no gain K"
        raise InputError("not a design", where=where, expected="the proof of a gain", got=got)
    facts = proved_facts(data)
    figures, _ = delay_lti.figures_if_known(*_loop_of(facts))
    return Result(**facts, figures=figures, certificate=_kept(data))


def _observes(data: Any) -> bool:
    return isinstance(data, dict) and data.get("kind") == "output-feedback"


def _require_proof(data: Any, where: str) -> None:
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)


def _loop_of(facts: dict[str, Any]) -> tuple[DelaySystem, Matrix]:
    """Return the system and the gain of the loop that a proof is about."""
    pair = facts["observer"]
    return (facts["system"], facts["K"]) if pair is None else (pair.system, pair.gain)


def _kept(data: dict[str, Any]) -> dict[str, Any]:
    """Return the certificate in a file."""
    if _observes(data):
        return {key: value for key, value in data.items() if key not in ("figures", "schema")}
    return {key: data[key] for key in _OF_A_GAIN if key in data}


def _figures_to_json(design: Result) -> dict[str, Any]:
    """Return the figures of the nominal loop as JSON values."""
    names = (*FIGURES, "exact_norm_upper")
    figures: dict[str, Any] = {name: getattr(design, name) for name in names}
    margin = design.delay_margin
    figures["delay_margin"] = None if margin is None else list(margin)
    if design.worst_case is not None:  # else left out: a design that is read is written as it was
        figures["worst_case"] = {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(design.worst_case).items()
        }
    return figures


def _has_figures(figures: Any) -> bool:
    """Whether these are the figures of a design, and nothing else."""
    known = {*FIGURES, *LATER_FIGURES}
    return isinstance(figures, dict) and set(FIGURES) <= set(figures) <= known


def _figures_from_json(
    figures: dict[str, Any], where: str, system: DelaySystem, K: Matrix
) -> tuple[float | None, NominalFigures]:
    """Return the solver's least gamma, and the figures of a nominal loop; None for what is absent.

    Raises
    ------
    InputError : values of another kind or number.
    """
    values: dict[str, Any] = {
        name: _number_or_none(figures.get(name), f"{where}: {name}")
        for name in (*FIGURES, "exact_norm_upper")
    }
    margins, worst = figures.get("delay_margin"), figures.get("worst_case")
    if margins is not None:
        margins = _margins(margins, f"{where}: delay_margin", len(system.delays))
    if worst is not None:
        worst = delay_lti.worst_case_from_json(worst, f"{where}: worst_case", system.C.shape[1])
    least = values.pop("least_gamma")
    values |= {"delay_margin": margins, "worst_case": worst}
    return least, NominalFigures.with_values(system, K, values)


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
