"""A design as JSON: the certificate that proves it, and the figures beside it."""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.errors import InputError
from cosim.hinf.certificate import check_certificate
from cosim.hinf.synthesis import Design
from cosim.hinf.system_json import system_from_json

_FIGURES = ("gamma", "least_gamma", "abscissa", "exact_norm", "norm_frequency")


def design_to_json(design: Design) -> dict[str, Any]:
    """JSON values: `claim`, `system`, `variables`, `K` of the proof, and `figures`."""
    return {
        **design.certificate,
        "figures": {name: getattr(design, name) for name in _FIGURES}
        | {"k1": list(design.k1), "k2": list(design.k2)},
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
    figures = data.get("figures")
    if not isinstance(figures, dict) or not {*_FIGURES, "k1", "k2"} <= set(figures):
        raise InputError(
            "figures are missing from this design",
            where=where,
            expected=f"figures: {', '.join(_FIGURES)}, k1, k2",
        )
    return Design(
        system=system_from_json(data["system"]),
        K=np.array(data["K"], dtype=float),
        k1=tuple(figures["k1"]),
        k2=tuple(figures["k2"]),
        certificate={key: data[key] for key in ("claim", "system", "variables", "K")},
        **{name: figures[name] for name in _FIGURES},
    )
