"""Guarantees that a certificate may prove beside gamma: decay, damping, |K|, peaks, outages.

In the JSON of a certificate each has its own proof and its own claim:

    "claim": {..., "guarantees": {"decay": {...}}},  "guarantees": {"decay": {...}}
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from importlib import import_module
from typing import TYPE_CHECKING, Any

from cosim.hinf.certificate.document import ProvedValue
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.words import theorem_of
from cosim.models import DelaySystem, Matrix

if TYPE_CHECKING:
    from cosim.hinf.certificate.control_limits import GainLimit, PeakControl
    from cosim.hinf.certificate.damping import Damping
    from cosim.hinf.certificate.decay import Decay
    from cosim.hinf.certificate.guarantee import Guarantee
    from cosim.hinf.certificate.outage_guarantee import Outages
    from cosim.hinf.certificate.state_peaks import StatePeaks

KEY = "guarantees"
"""The key of the guarantees in a certificate."""
_KINDS = {
    "decay": ("decay", "Decay"),
    "damping": ("damping", "Damping"),
    "gain_limit": ("control_limits", "GainLimit"),
    "peak_control": ("control_limits", "PeakControl"),
    "state_peaks": ("state_peaks", "StatePeaks"),
    "outages": ("outage_guarantee", "Outages"),
}
"""Module and class of each, loaded for one that a file has."""


@dataclass(frozen=True, eq=False, repr=False)
class Guarantees(ProvedValue):
    """The guarantees of a design; None where a constraint was not set."""

    decay: Decay | None = None
    damping: Damping | None = None
    gain_limit: GainLimit | None = None
    peak_control: PeakControl | None = None
    state_peaks: StatePeaks | None = None
    outages: Outages | None = None

    def __repr__(self) -> str:
        proved = "; ".join(one.claim()["property"] for _, one in self._each())
        return f"<Guarantees: {proved or 'none'}>"

    def _each(self) -> list[tuple[str, Guarantee]]:
        named = [(field.name, getattr(self, field.name)) for field in fields(self)]
        return [(name, value) for name, value in named if value is not None]

    def claim(self) -> dict[str, Any]:
        """Return the part of the claim of a certificate: empty, or the key `guarantees`."""
        return {KEY: {name: one.claim() for name, one in self._each()}} if self._each() else {}

    def to_json(self) -> dict[str, Any]:
        """Return the part of a certificate: empty, or the key `guarantees` with the proofs."""
        return {KEY: {name: one.to_json() for name, one in self._each()}} if self._each() else {}

    def beside(self, certificate: dict[str, Any]) -> dict[str, Any]:
        """Return a certificate with these in its claim and its theorem, and their proofs."""
        claim = certificate["claim"] | self.claim()
        stated = {"theorem": theorem_of(claim), "claim": claim}
        return certificate | stated | self.to_json()

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return the first that is not proved, and why; None if all are.

        Raises
        ------
        InputError : a proof that is too large.
        """
        for name, one in self._each():
            reason = one.failure(system, gain)
            if reason is not None:
                return f"{name}: {reason}"
        return None


def guarantees_from_json(data: dict[str, Any], system: DelaySystem, gain: Matrix) -> Guarantees:
    """Read the guarantees of a certificate about a loop; none where it has no such key.

    Raises
    ------
    InputError : an unknown or missing key, a wrong shape, a text that is no number.
    """
    if KEY not in data:
        return Guarantees()
    tables = data[KEY]
    known_keys(tables, KEY, tuple(_KINDS))
    proofs: dict[str, Any] = {
        name: _kind_of(name).from_json(table, system, gain, f"{KEY}.{name}")
        for name, table in tables.items()
    }
    return Guarantees(**proofs)


def _kind_of(name: str) -> type[Guarantee]:
    module, kind = _KINDS[name]
    guarantee: type[Guarantee] = getattr(import_module(f"cosim.hinf.certificate.{module}"), kind)
    return guarantee
