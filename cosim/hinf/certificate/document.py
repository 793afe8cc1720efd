"""A certificate as it stands in files, that says what it is instead of printing its fractions."""

from __future__ import annotations

from typing import Any

from cosim.core import html_table
from cosim.hinf.certificate.frozen_json import FrozenDict
from cosim.hinf.certificate.words import theorem_of
from cosim.models import Value


class Certificate(FrozenDict):
    """The JSON values of a certificate: a dictionary that cannot be changed."""

    def __repr__(self) -> str:
        return f"<Certificate: {claim_words(self.get('claim', {}))}; check_certificate proves it>"

    def _repr_html_(self) -> str:
        """Return every sentence of the theorem, as notebooks show them."""
        return html_table(repr(self), theorem_rows(self.get("claim", {})))


class ProvedValue(Value):
    """A value with a claim and the JSON of its proof: two are equal where these are."""

    def claim(self) -> dict[str, Any]:
        """Return what is claimed, as JSON values."""
        raise NotImplementedError

    def to_json(self) -> dict[str, Any]:
        """Return what proves it, as JSON values."""
        raise NotImplementedError

    def content(self) -> tuple[Any, ...]:
        """Return the claim and the proof; exact numbers have no hash of their own."""
        return FrozenDict(self.claim()), FrozenDict(self.to_json())


def claim_words(claim: dict[str, Any]) -> str:
    """Return a claim in a few words: what is proved, and for which delays."""
    what = str(claim.get("property", "no claim"))
    gamma = claim.get("gamma")
    if gamma is not None:
        top, _, bottom = str(gamma).partition("/")
        what = what.replace("gamma", f"{int(top) / int(bottom or 1):.6g}")
    ages = [
        f"delay {i} {delay['age'].replace('up to d', '').strip(', ')} up to {delay['d']:g} s"
        for i, delay in enumerate(claim.get("delays", ()), 1)
    ]
    return ", ".join([what, *ages])


def theorem_rows(claim: dict[str, Any]) -> dict[str, str]:
    """Return the sentences of a claim's theorem by what they are about."""
    if "property" not in claim:
        return {}
    rows: dict[str, str] = {}
    for sentence in theorem_of(claim):
        name, _, text = sentence.partition(": ")
        rows[name] = f"{rows[name]}; {text}" if name in rows else text
    return rows
