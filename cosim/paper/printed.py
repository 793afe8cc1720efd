"""The numbers that section 2 of the paper prints, and its misprints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

Parameters = Mapping[str, Fraction]

F_ROWS = (
    {"vv": "0.124", "ww": "0.397", "rr": "0.262", "vr": "1.153"},
    {"ur": "-0.353", "wr": "-0.141", "uv": "-0.149", "vw": "0.095"},
    {"vv": "-0.041", "rr": "-0.125", "uw": "-0.181", "vr": "0.144"},
    {"ur": "-0.313", "wr": "0.138", "uv": "-0.031", "vw": "-0.095"},
)
"""Rows 5 to 8 of f(x) below Eq. (4): coefficients by product of (u, v, w, r) = (x5, ..., x8)."""

THRUST_MAP = {
    (0, 0): "1.661e-4",
    (1, 1): "1.049e-4",
    (2, 2): "4.29e-5",
    (3, 3): "4.84e-5",
    (1, 3): "-2.40e-6",
    (3, 1): "-2.40e-6",
}
"""The matrix between (T_x, T_y, T_z, M_z) and u, above Eq. (4); its other entries are zero."""


@dataclass(frozen=True)
class Misprint:
    """A misprint in Eq. (3) or Table 1 that the paper's own f(x) shows.

    name : name of the number or term.
    printed, corrected : the printed and the correct text.
    undo : puts this misprint back into the corrected parameters of the vehicle.
    """

    name: str
    printed: str
    corrected: str
    undo: Callable[[Parameters], Parameters]


def _with(name: str, value: str) -> Callable[[Parameters], Parameters]:
    return lambda p: {**p, f"hydro.{name}": Fraction(value)}


def _named_vw(p: Parameters) -> Parameters:
    # a derivative X_vw would belong to the product v w, which Eq. (3) does not have in surge
    return {**p, "hydro.X_vv": Fraction(0)}


MISPRINTS = (
    Misprint("X_udot in Table 1", "7.6e-3", "-7.6e-3", _with("X_udot", "7.6e-3")),
    Misprint("N_ur in Table 1", "-1.6e-3", "-1.6e-2", _with("N_ur", "-1.6e-3")),
    Misprint("the name X_vw in Table 1", "X_vw", "X_vv", _named_vw),
    Misprint("w r in the sway row of Eq. (3)", "no such term", "L³ Y_wr w r", _with("Y_wr", "0")),
    Misprint("Y_r r² in the sway row of Eq. (3)", "L⁴ Y_r r²", "L⁴ Y_rdot ṙ", _with("Y_rdot", "0")),
)
