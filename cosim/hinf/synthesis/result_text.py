"""What a design or an analysis says of itself: in a few words, and as rows of a table."""

from __future__ import annotations

from typing import Any

from cosim.core import matrix_text


def proved_words(result: Any) -> str:
    """Return what a design or an analysis proves, in a few words."""
    if not result.certified:
        return f"not certified: {result.reason}"
    delays = result.system.delays
    cover = ", for every smaller delay too" if delays and result.covers_smaller_delays else ""
    what = "stability" if result.gamma is None else f"gamma {result.gamma:.6g}"
    on = ", on the support of each delay" if support_words(result.certificate) else ""
    return f"{what} certified{cover}{on}"


def support_words(certificate: dict[str, Any] | None) -> str:
    """Return the support of each delay that a certificate names: "delay 1: states 3, 4"."""
    if certificate is None or "terms" not in certificate.get("variables", {}):
        return ""
    positive = [i for i, delay in enumerate(certificate["system"]["delays"], 1) if delay["d"] > 0]
    each = zip(positive, certificate["variables"]["terms"], strict=True)
    return "; ".join(
        f"delay {i}: {of} {', '.join(map(str, term[of]))}"
        for i, term in each
        for of in ("states", "controls")
        if of in term
    )


def result_rows(result: Any) -> dict[str, str]:
    """Return the rows about a design or an analysis in a notebook."""
    rows = {} if result.K is None else {"K": matrix_text(result.K, most=24)}
    rows["certified"] = proved_words(result)
    on = support_words(result.certificate)
    if on:
        rows["proved on the support of each delay"] = on
    if result.abscissa is not None:
        rows["rightmost root (computed)"] = f"real part {result.abscissa:.6g} 1/s"
    if result.exact_norm is not None:
        rows["norm of the nominal loop (computed)"] = f"{result.exact_norm:.6g}"
    if result.exact_norm_upper is not None:
        rows["the same, an upper bound (proved)"] = f"{result.exact_norm_upper:.6g}"
    for i, margin in enumerate(result.delay_margin or (), 1):
        rows[f"stable up to delay {i} of (computed)"] = (
            "any" if margin is None else f"{margin:.6g} s"
        )
    return rows
