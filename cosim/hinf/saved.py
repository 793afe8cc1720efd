"""A design as JSON: the certificate that proves it, and the figures beside it."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.hinf.certificate import check_certificate
from cosim.hinf.synthesis import Design
from cosim.hinf.system_json import number, system_from_json

_FIGURES = ("least_gamma", "abscissa", "exact_norm", "norm_frequency")
"""Computed beside the proof: notes, not part of the claim."""


def design_to_json(design: Design) -> dict[str, Any]:
    """JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`."""
    return {
        **design.certificate,
        "figures": {name: getattr(design, name) for name in _FIGURES},
    }


def design_from_json(data: Any, *, where: str) -> Design:
    """A design from its JSON; its proof is checked again.

    Raises
    ------
    InputError : not a design, or one whose proof does not hold.
    """
    proof = check_certificate(data)
    if not proof.valid:
        raise InputError("the proof of this design does not hold", where=where, got=proof.reason)
    if "kind" in data:
        raise InputError("not a design", where=where, got=f"a proof of kind {data['kind']}")
    figures = data.get("figures")
    if not isinstance(figures, dict) or set(figures) != set(_FIGURES):
        raise InputError(
            "figures are missing from this design",
            where=where,
            expected=f"figures: {', '.join(_FIGURES)}",
        )
    # what is claimed is read off the proof, never off a note beside it
    proved = data["variables"]
    notes: dict[str, Any] = {
        name: None if figures[name] is None else number(figures[name], f"{where}: {name}")
        for name in _FIGURES
    }
    return Design(
        system=system_from_json(data["system"]),
        K=np.array(data["K"], dtype=float),
        gamma=None if proved["gamma"] is None else _double(proved["gamma"]),
        k1=tuple(map(_double, proved["k1"])),
        k2=tuple(map(_double, proved["k2"])),
        certificate={key: data[key] for key in ("claim", "system", "variables", "K")},
        **notes,
    )


def _double(text: str) -> float:
    return float(Fraction(text))
