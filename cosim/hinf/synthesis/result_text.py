"""What a design or an analysis says of itself: in a few words, and as rows of a table."""

from __future__ import annotations

from typing import Any

from cosim.core import matrix_text


def proved_words(found: Any) -> str:
    """Return what a design or an analysis proves, in a few words."""
    if not found.certified:
        return f"not certified: {found.reason}"
    delays = found.system.delays
    cover = ", for every smaller delay too" if delays and found.covers_smaller_delays else ""
    what = "stability" if found.gamma is None else f"gamma {found.gamma:.6g}"
    return f"{what} certified{cover}"


def result_rows(found: Any) -> dict[str, str]:
    """Return the rows about a design or an analysis in a notebook."""
    rows = {} if found.K is None else {"K": matrix_text(found.K, most=24)}
    rows["certified"] = proved_words(found)
    if found.abscissa is not None:
        rows["rightmost root (computed)"] = f"real part {found.abscissa:.6g} 1/s"
    if found.exact_norm is not None:
        rows["norm of the nominal loop (computed)"] = f"{found.exact_norm:.6g}"
    if found.exact_norm_upper is not None:
        rows["the same, an upper bound (proved)"] = f"{found.exact_norm_upper:.6g}"
    for i, margin in enumerate(found.delay_margin or (), 1):
        rows[f"stable up to delay {i} of (computed)"] = (
            "any" if margin is None else f"{margin:.6g} s"
        )
    return rows
