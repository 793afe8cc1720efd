"""The check of a certificate, formatted for a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from cosim import hinf, replay
from cosim.cli.result_view import acts_of, condition_of
from cosim.cli.terminal import facts
from cosim.core import at_least, at_most
from cosim.models import DelaySystem

_MOST_DIFFERENCES = 10
_WHOSE = {
    "file": "",
    "FMU": "the gain that the FMU starts with; the proof does not hold for any other",
    "trace": "the gain of the run",
}


def certificate_line(file: str, certificate: hinf.CertificateCheck) -> str:
    """Say whether a certificate proves its claim, and what that is."""
    if not certificate.valid:
        return f"not proved: {file}: {certificate.reason}"
    gamma = certificate.claim["gamma"]
    bound = "" if gamma is None else f"; gamma {_bound(certificate.claim)}"
    return f"proved: {file}: {certificate.claim['property']}{bound}"


def certificate_view(
    certificate: hinf.CertificateCheck,
    found: replay.EmbeddedCertificate,
    system: DelaySystem,
    theorem: list[str],
    compared_with: str | None,
    differences: list[str] | None,
) -> RenderableType:
    """Show what a certificate is about, its claim, and for which gain it holds.

    theorem : its sentences; none are shown where there are none.
    compared_with, differences : the system of --system, and where it is another; or None.
    """
    gain = ("gain", "K in the certificate", _WHOSE[found.container])
    rows = facts(
        *_about(system, compared_with, differences),
        *_claim(certificate.claim),
        *[gain] * ("K" in found.data),  # a refutation is about every gain
        *_rest(certificate.not_read, f"{found.sha256}"),
    )
    if not theorem:
        return rows
    return Group(rows, Text("theorem\n" + "\n".join(f"  {text}" for text in theorem)))


def _about(
    system: DelaySystem, compared_with: str | None, differences: list[str] | None
) -> Iterator[tuple[str, str, str]]:
    about = system_facts(system)
    yield "system", about["name"] or "without a name", about["sizes"]
    yield "  matrices", "", about["matrices"]
    if compared_with is not None:
        same = "every matrix, delay and age is the same" if not differences else ""
        yield "  compared with", compared_with, same
    for text in (differences or ())[:_MOST_DIFFERENCES]:
        yield "    differs", "", text
    if len(differences or ()) > _MOST_DIFFERENCES:
        yield "    differs", "", f"in {len(differences or ())} places in all"


def _claim(claim: Any) -> Iterator[tuple[str, str, str]]:
    yield "claim", claim["property"], ""
    yield "condition", condition_of(claim), ""
    if claim["gamma"] is not None:
        yield "gamma", _bound(claim), "rounded here, exact in the file"
    for name in (name for name in ("k1", "k2") if name in claim):
        yield name, ", ".join(f"{float(Fraction(x)):g}" for x in claim[name]), ""
    for i, delay in enumerate(claim["delays"], 1):
        acts = acts_of(delay["feedback"])
        known = [f"{key} = {delay[key]:g}" for key in ("least_age", "rate") if key in delay]
        more = f" ({', '.join(known)})" if known else ""
        yield f"delay {i}", f"{delay['d']:g} s", f"{delay['age']}{more}{acts}"
    blocks = ", ".join(f"{p} x {q}" for p, q in claim.get("uncertainty_blocks", ()))
    covered = "every F(t) with F'F <= I" if claim["uncertain"] else "none"
    yield "uncertainty", covered, f"F block diagonal: {blocks}" if blocks else ""
    for name, more in claim.get("guarantees", {}).items():
        key = next(key for key in ("rate", "ratio", "share", "bound", "bounds") if key in more)
        values = more[key] if isinstance(more[key], list) else [more[key]]
        outward = at_least if key in {"rate", "ratio"} else at_most
        formatted = ", ".join(outward(value) for value in values)
        if "within" in more:
            formatted += f" within {at_least(more['within'])} 1/s"
        yield name.replace("_", " "), formatted, more["property"]


def _bound(claim: Any) -> str:
    """Return gamma, rounded to the side on which the claim stays true."""
    refuted = not claim["property"].startswith("stability")
    return at_least(claim["gamma"]) if refuted else at_most(claim["gamma"])


def _rest(not_read: Any, sha256: str) -> Iterator[tuple[str, str, str]]:
    unproved = ", ".join(not_read)
    yield "not read", "", f"{unproved}: nothing proves these" if unproved else "nothing"
    yield "SHA-256", sha256[:16], "of the certificate without its notes"


def system_facts(system: DelaySystem) -> dict[str, Any]:
    """Return the name, the sizes and the matrices of a system, as JSON values."""
    (n, m), (p, q), (r, s) = system.B.shape, system.D1.shape, (len(system.H), system.E.shape[1])
    counts = ((n, "state"), (m, "input"), (q, "disturbance"), (p, "output"))
    sizes = ", ".join(f"{count} {what}{'s' * (count != 1)}" for count, what in counts)
    sizes += f", F(t) {s} x {r}" if s else ""
    matrices = [key for key in ("A", "B", "C", "D", "D1", "D2", "E", "H") if _has(system, key)]
    matrices += [
        f"{key}{i}"
        for i, delay in enumerate(system.delays, 1)
        for key in ("A", "H")
        if _has(delay, key)
    ]
    return {
        "name": system.name,
        "sizes": sizes,
        "matrices": ", ".join(matrices) + "; the others are zero or absent",
    }


def _has(part: Any, key: str) -> bool:
    return bool(getattr(part, key).any())
