"""The multipliers of the uncertainty, exactly: one positive number for each block of F.

With p = F(t) q and F = diag(F_1, ..., F_b), F_i(t)'F_i(t) <= I is |p_i|^2 <= |q_i|^2, block by
block and for complex F_i as well, so that for any eps_i >= 0

    sum_i eps_i (|q_i|^2 - |p_i|^2) = q'L_q q - p'L_p p >= 0,

L_p (s, s) and L_q (r, r) diagonal with eps_i on the columns of E and the rows of H of block i. One
full block is the case b = 1. Lemma 1 reads E F H + H'F'E' <= E L_p E' + H'L_q^-1 H.

One number stands for itself in the variables and in the JSON; several are a tuple, a list there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core import InputError, format_value
from cosim.hinf.exact import exact, from_text, to_text
from cosim.hinf.theorems import separated

if TYPE_CHECKING:
    from cosim.models import DelaySystem

Blocks = tuple[tuple[slice, slice], ...]
"""The columns of E and the rows of H of every block, `DelaySystem.blocks`."""


def joined(values: Sequence[Any]) -> Any:
    """Return one number per block as the variables have them: one alone, several as a tuple."""
    return values[0] if len(values) == 1 else tuple(values) or None


def exact_eps(system: DelaySystem, eps: Any) -> Any:
    """Convert the doubles of `eps` to rationals; None where nothing is uncertain.

    Raises
    ------
    InputError : not one finite number per block of F.
    """
    if not system.blocks:
        return None
    values = separated(eps)
    if len(values) != len(system.blocks) or not all(np.isfinite(x) for x in values):
        raise InputError(
            "not finite, or not one per block of F",
            where="eps",
            expected=_expected("finite number", system),
            got=repr(eps),
        )
    return joined([exact(value) for value in values])


def eps_to_json(eps: Any) -> Any:
    """Return the JSON value that `eps_from_json` reads: "p/q", a list of them, or null."""
    texts = [to_text(value) for value in separated(eps)]
    return texts if len(texts) > 1 else joined(texts)


def eps_from_json(system: DelaySystem, value: Any, where: str) -> Any:
    """Read what `eps_to_json` wrote for a system.

    Raises
    ------
    InputError : not one "p/q" per block of F, or anything but null where nothing is uncertain.
    """
    several = len(system.blocks) > 1
    fits = isinstance(value, list) and len(value) == len(system.blocks)
    if (value is None) == bool(system.blocks) or (several and not fits):
        raise InputError(
            "does not fit the system",
            where=where,
            expected=_expected("number", system) if system.blocks else "null",
            got=format_value(value),
        )
    if several:
        return tuple(from_text(x, f"{where}[{i}]") for i, x in enumerate(value))
    return None if value is None else from_text(value, where)


def _expected(what: str, system: DelaySystem) -> str:
    count = len(system.blocks)
    return f"a {what}" if count == 1 else f"a list of {count} {what}s, one per block of F"
