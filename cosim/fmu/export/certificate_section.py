"""The section of the documentation page about a controller's certificate."""

from __future__ import annotations

import hashlib
import html
import json
from decimal import ROUND_CEILING, Context, Decimal
from fractions import Fraction
from typing import Any

from cosim.fmu.export.spec import CERTIFICATE

_UP = Context(prec=10, rounding=ROUND_CEILING)


def certified_section(certificate: bytes, file: str) -> str:
    """Return HTML: the claim, its conditions, and the command that checks it.

    Parameters
    ----------
    certificate : the bytes of its JSON in the FMU.
    file : name of the FMU.
    """
    data = json.loads(certificate)
    items = "".join(f"<li>{html.escape(line)}</li>\n" for line in _claims(data))
    values = "<code>K[i,j]</code>"
    if data.get("kind") == "output-feedback":
        values += " and <code>L.NAME[i,j]</code>"
    digest = hashlib.sha256(certificate).hexdigest()
    return (
        '<section class="certified"><h2 id="certified">What is certified</h2>\n'
        f"<p>Proved in exact rational arithmetic for the start values of {values}, "
        f"double by double, about the system that the certificate describes:</p>\n<ul>\n{items}"
        "</ul>\n<p>Any other K voids this, and so do measurements older, commands limited, or "
        "states outside what the design allows for. The proof is "
        f"<code>{CERTIFICATE}</code> in this FMU (SHA-256 <code>{digest}</code>); it can be "
        f"checked without a solver: <code>cosim certificate check {html.escape(file)}</code>.</p>"
        "</section>\n"
    )


def _claims(data: dict[str, Any]) -> list[str]:
    claim = data["claim"]
    lines = ["asymptotically stable"]
    if claim["gamma"] is not None:
        gamma = _not_below(Fraction(claim["gamma"]))
        lines.append(f"gain from disturbance w to output z at most gamma = {gamma}")
    if claim["uncertain"]:
        blocks = ", ".join(f"{p} x {q}" for p, q in claim.get("uncertainty_blocks", ()))
        more = f", block diagonal with blocks {blocks}" if blocks else ""
        lines.append(f"for every uncertainty F(t) with F'F ≤ I{more}")
    if data.get("kind") == "output-feedback":
        return lines + _claims_of_observer(data)
    for number, delay in enumerate(claim["delays"], 1):
        text = f"delay {number} with d = {delay['d']:g} s, age {delay['age']}"
        if delay["feedback"]:
            text += "; the control acts through it: it is the age of the measurements"
        lines.append(text)
    if not any(delay["feedback"] for delay in claim["delays"]):
        lines.append(
            "feedback without any delay: what sampling and a link add to it is not covered"
        )
    return lines


def _claims_of_observer(data: dict[str, Any]) -> list[str]:
    """Return the conditions of an output feedback: plant and observer are one loop."""
    lines = ["of plant and observer as one loop, with the errors of the measurements in w"]
    for one in data["measurements"]:
        kind = "of any age up to" if one.get("any_age") else "of an age of exactly"
        lines.append(f"measurement {one['name']} {kind} d = {one['d']:g} s")
    age = data["command_age"]
    late = "up to" if data["command_any_age"] else "exactly"
    lines.append(
        f"the command acts by an age of {late} {age:g} s"
        if age
        else "the command acts at once: what sampling adds to it is not covered"
    )
    return lines


def _not_below(value: Fraction) -> str:
    """Format a double exactly, any other number rounded up."""
    if Fraction(float(value)) == value:
        return repr(float(value))
    return str(_UP.divide(Decimal(value.numerator), Decimal(value.denominator)))
