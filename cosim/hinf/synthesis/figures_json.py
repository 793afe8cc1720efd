"""The figures of a nominal loop as JSON, beside the proof in the file of a design.

They are computed and no part of the claim; what is read is what was computed once, so that no
solver, and no processor, decides on the digits of a later run.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from cosim.core import InputError, format_value
from cosim.hinf import delay_lti
from cosim.hinf.certificate import number
from cosim.hinf.delay_lti import NominalFigures
from cosim.models import DelaySystem, Matrix

FIGURES = ("least_gamma", "abscissa", "exact_norm", "norm_frequency")
LATER_FIGURES = ("exact_norm_upper", "delay_margin", "worst_case")
"""Absent in older files: then None."""


def figures_to_json(least_gamma: float | None, figures: NominalFigures) -> dict[str, Any]:
    """Return the solver's least gamma and the figures as JSON values."""
    names = (*FIGURES[1:], "exact_norm_upper")
    values: dict[str, Any] = {"least_gamma": least_gamma}
    values |= {name: getattr(figures, name) for name in names}
    margin = figures.delay_margin
    values["delay_margin"] = None if margin is None else list(margin)
    if figures.worst_case is not None:  # else left out: a design that is read is written as it was
        values["worst_case"] = {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in asdict(figures.worst_case).items()
        }
    return values


def has_figures(figures: Any) -> bool:
    """Whether these are the figures of a design, and nothing else."""
    known = {*FIGURES, *LATER_FIGURES}
    return isinstance(figures, dict) and set(FIGURES) <= set(figures) <= known


def figures_from_json(
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
