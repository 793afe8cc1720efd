"""Rows of section 2: Eqs. (1)-(6), Table 1, f(x) and the thrust map."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from cosim.core import at_most
from cosim.hinf import design, system_by_name
from cosim.models import (
    TABLE_1,
    kinematics,
    thrust_map,
    velocity_coefficients,
)
from cosim.paper.row import MODEL, How, Row, Verdict

_AXES = ("surge", "sway", "heave", "yaw")
_STATE = {"u": "x5", "v": "x6", "w": "x7", "r": "x8"}

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


def model_rows() -> list[Row]:
    """Return the rows of section 2."""
    p = {name: Fraction(repr(value)) for name, value in TABLE_1.items()}
    return [
        _kinematics(),
        *(_misprint(slip, p) for slip in MISPRINTS),
        _heave(p),
        *_coefficients(p),
        *_thrust(p),
        _surge_and_sway(p),
        _maclaurin(),
        _vehicle_design(),
    ]


def unit_in_last_place(text: str) -> Fraction:
    """Return one unit of the last digit of a printed decimal."""
    mantissa, _, exponent = text.partition("e")
    decimals = len(mantissa.partition(".")[2])
    return Fraction(10) ** (int(exponent or 0) - decimals)


def agrees(value: Fraction, text: str) -> bool:
    """Return whether a value rounds to the printed decimal."""
    return abs(value - Fraction(text)) <= unit_in_last_place(text) / 2


def _kinematics() -> Row:
    rng = np.random.default_rng(4)
    gap = 0.0
    for psi, u, v, w, r in rng.uniform(-3, 3, size=(50, 5)):
        c, s = math.cos(psi), math.sin(psi)
        printed = (u * c - v * s, u * s + v * c, w, r)
        ours = kinematics(psi, (u, v, w, r), math)
        gap = max(gap, *(abs(a - b) for a, b in zip(ours, printed, strict=True)))
    return Row(
        MODEL,
        "Eqs. (1), (2): rows 1 to 4 of f(x)",
        "ẋ = u cos ψ - v sin ψ, ...",
        f"the vehicle simulated here differs by {gap:g} at 50 states",
        How.COMPUTED,
        Verdict.HOLDS,
        "Eq. (1) carries no numbers; its kinematics for four degrees of freedom is Eq. (2).",
    )


def _value(p: Parameters, row: int, product: str) -> Fraction:
    return velocity_coefficients(p)[row].get(product, Fraction(0))


def _printed_coefficients() -> list[tuple[int, str, str]]:
    return [(row, product, text) for row, f in enumerate(F_ROWS) for product, text in f.items()]


def _product(product: str) -> str:
    a, b = (_STATE[letter] for letter in product)
    return f"{a}²" if a == b else f"{a} {b}"


def _misprint(slip: Misprint, p: Parameters) -> Row:
    wrong = slip.undo(p)
    hit = [
        (row, product, text)
        for row, product, text in _printed_coefficients()
        if agrees(_value(p, row, product), text) and not agrees(_value(wrong, row, product), text)
    ]
    # the coefficient that shows the misprint best
    row, product, text = max(
        hit, key=lambda at: abs(_value(wrong, at[0], at[1]) / Fraction(at[2]) - 1)
    )
    with_slip, without = (float(_value(q, row, product)) for q in (wrong, p))
    return Row(
        MODEL,
        slip.name,
        slip.printed,
        f"{slip.corrected}: row {row + 5} gets {without:.4f} {_product(product)}, as printed "
        f"{with_slip:.4f}",
        How.COMPUTED,
        Verdict.CORRECTED,
        f"The paper's own f(x) has {text} there. Coefficients of its 16 that need the "
        f"correction: {len(hit)}.",
    )


def _heave(p: Parameters) -> Row:
    coefficient = float(_value(p, 2, "vv"))
    return Row(
        MODEL,
        "Z_vw in Table 1 and Eq. (3)",
        "Z_vw v²",
        f"Z_vv v²: row 7, x6² is {coefficient:.4f}",
        How.COMPUTED,
        Verdict.CORRECTED,
        "Only the name is misprinted: the derivative of v² is Z_vv.",
    )


def _coefficients(p: Parameters) -> list[Row]:
    literal = p
    for slip in MISPRINTS:
        literal = slip.undo(literal)
    rows = []
    for row, product, text in _printed_coefficients():
        value, as_printed = _value(p, row, product), _value(literal, row, product)
        causes: tuple[str, ...] = ()
        needs = [s for s in MISPRINTS if not agrees(_value(s.undo(p), row, product), text)]
        if not agrees(value, text):
            verdict = Verdict.DOES_NOT
            why = (
                f"{float(value):.4f} rounds to another number, and none of the misprints of "
                "Eq. (3) and Table 1 explains it."
            )
        elif agrees(as_printed, text):
            verdict, why = Verdict.HOLDS, "Eq. (3) with Table 1 gives it as printed."
        else:
            causes = tuple(dict.fromkeys(s.name for s in needs))
            verdict = Verdict.CORRECTED
            why = (
                f"Needs the correction of {' and '.join(causes)}; without any it is "
                f"{float(as_printed):.3f}."
            )
        what = f"f(x), row {row + 5} ({_AXES[row]}): {_product(product)}"
        computed = f"{float(value):.4f}"
        rows.append(_number_row(what, text, float(value), computed, verdict, why, causes))
    return rows


def _number_row(
    what: str,
    printed: str,
    value: float,
    computed: str,
    verdict: Verdict,
    why: str,
    follows_from: tuple[str, ...] = (),
) -> Row:
    return Row(
        *(MODEL, what, printed, computed, How.COMPUTED, verdict, why),
        printed_value=float(printed),
        value=value,
        follows_from=follows_from,
    )


def _thrust(p: Parameters) -> list[Row]:
    b = thrust_map(p)
    rows = []
    for (i, j), text in THRUST_MAP.items():
        value = Fraction(b[i][j])
        digits = len(text.partition("e")[0].replace("-", "")) - 2
        holds = agrees(value, text)
        literal = Fraction(thrust_map(MISPRINTS[0].undo(p))[i][j])
        if i != j:
            why = (
                "The sign: the mass matrix couples sway and yaw with a minus, so its inverse has "
                "a plus; f(x) is printed with the plus."
            )
        elif agrees(literal, text):
            why = "The inverse of the mass matrix of Eq. (3)."
        else:
            why = (
                "Needs the correction of X_udot in Table 1; as printed it gives "
                f"{float(literal):.3e}."
            )
        if not holds:
            verdict = Verdict.CORRECTED if agrees(-value, text) else Verdict.DOES_NOT
        else:
            verdict = Verdict.HOLDS if agrees(literal, text) else Verdict.CORRECTED
        what, computed = _entry(i, j), float(value)
        formatted = f"{computed:.{digits}e}"
        # the sign is one error in two entries
        cause = MISPRINTS[0].name if i == j else _entry(min(i, j), max(i, j))
        causes = () if what == cause else (cause,)
        rows.append(_number_row(what, text, computed, formatted, verdict, why, causes))
    return rows


def _entry(i: int, j: int) -> str:
    return f"thrust map above Eq. (4): entry ({i + 1}, {j + 1})"


def _surge_and_sway(p: Parameters) -> Row:
    """Test what is left without control in surge and sway, by Hautus' criterion at the root 0."""
    A = np.block([[np.zeros((4, 4)), np.eye(4)], [np.zeros((4, 8))]])
    b = np.array(thrust_map(p), dtype=np.float64)
    B = np.vstack([np.zeros((4, 2)), b[:, 2:]])
    rank = int(np.linalg.matrix_rank(np.hstack([A, B / np.abs(B).max()])))
    return Row(
        MODEL,
        "section 1: no control is needed in surge and sway",
        '"there is no need to impose control to the movement in surge and sway"',
        f"with the thrust of heave and yaw alone the rank of [A, B] at the root 0 is {rank} of 8: "
        "position and speed in surge and sway cannot be stabilised",
        How.COMPUTED,
        Verdict.DOES_NOT if rank < 8 else Verdict.HOLDS,
        "Eq. (4) has a control for each of the four axes, and objective (i) asks for a stable "
        "loop of all eight states.",
        value=float(rank),
    )


def _maclaurin() -> Row:
    state = (0.3, 0.7, -0.4, 0.2, 0.5)  # psi, u, v, w, r: arbitrary

    def neglected(scale: float) -> float:
        psi, u, v, w, r = (scale * value for value in state)
        full = kinematics(psi, (u, v, w, r), math)
        printed = (u - psi * v, v + psi * u, w, r)
        return math.dist(full, printed)

    order = math.log2(neglected(0.02) / neglected(0.01))
    return Row(
        MODEL,
        "Maclaurin form of f(x)",
        "f(x) = [0 I; 0 0] x + terms of second order",
        f"what is neglected shrinks with the power {order:.2f} of the state",
        How.COMPUTED,
        Verdict.HOLDS,
        "A form complete to second order neglects third order. The vehicle here is simulated with "
        "cos ψ and sin ψ in full.",
        value=round(order, 4),
    )


def _vehicle_design() -> Row:
    named = system_by_name("auv")
    designed = design(named.system, named.k1, named.k2, gamma=named.gamma, order=None)
    return Row(
        MODEL,
        "Eqs. (5), (6): the vehicle as an uncertain system with delay",
        "ΔA, A1, C, E, H without numbers; no controller for the vehicle",
        f"with this project's choice: γ = {at_most(designed.gamma, 5)} certified, exact nominal "
        f"norm {designed.exact_norm:.4g}",
        How.CERTIFIED,
        Verdict.NOT_COMPARABLE,
        "The example of section 5 is not a vehicle. Here E and H are proved over an envelope of "
        "speeds, and the feedback is delayed.",
        value=designed.gamma,
    )
