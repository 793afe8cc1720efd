"""Formulas in LaTeX as MathML: no font and no script has to be loaded for them."""

from __future__ import annotations

from typing import Any

from latex2mathml.converter import convert


def fence(source: str, *_of_the_fence: Any, **_more: Any) -> str:
    """Return the MathML of a ```math fence, one formula per paragraph."""
    formulas = (" ".join(part.split()) for part in source.split("\n\n"))
    return "".join(f'<div class="math">{convert(f, display="block")}</div>' for f in formulas)
