"""Pictures with matplotlib (the extra `plot`): load it, write a figure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cosim.core.extras import optional
from cosim.core.files import not_written, written_beside


def pyplot() -> Any:
    """Import matplotlib's pyplot for use without a display; `InputError` if not installed."""
    needed = {"extra": "plot", "what": "pictures need matplotlib"}
    optional("matplotlib", **needed).use("Agg")
    return optional("matplotlib.pyplot", **needed)


def drawing() -> Any:
    """Import matplotlib's pyplot as its user has it; `InputError` if not installed."""
    return optional("matplotlib.pyplot", extra="plot", what="plots need matplotlib")


def axes_or_new(ax: Any) -> Any:
    """Return the axes that are given, or new ones in a figure of their own."""
    return drawing().subplots(layout="constrained")[1] if ax is None else ax


def save_picture(figure: Any, target: Path, dpi: int = 110) -> Path:
    """Write a figure to a file, and the folders it needs.

    Raises
    ------
    InputError : it cannot be written, or its format is not known.
    """
    expected = "a .png, .svg or .pdf file in a folder that can be written"
    with (
        not_written("the picture", target, faults=(OSError, ValueError), expected=expected),
        written_beside(target) as partial,
    ):
        figure.savefig(partial, dpi=dpi, format=target.suffix[1:] or None)
    return target
