"""A fact: a figure or a statement with its unit and how it is known. Views render lists of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

Known = Literal["certified", "computed", "measured", "declared", ""]
"""How a fact is known: by an exact proof, to a tolerance, of this run, or as files say."""


@dataclass(frozen=True)
class Fact:
    """What is said under a verdict.

    Attributes
    ----------
    label : what it is about.
    value : a number, or words.
    unit : of a number; "" without one.
    known : how it is known.
    """

    label: str
    value: float | str
    unit: str = ""
    known: Known = ""

    @property
    def text(self) -> str:
        """The value with its unit: "0.25 m"."""
        if isinstance(self.value, str):
            return self.value
        return f"{self.value:.4g} {self.unit}".rstrip()

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return {"label": self.label, "value": self.value, "unit": self.unit, "known": self.known}

    @classmethod
    def from_json(cls, data: Any) -> Fact | None:
        """Read what `to_json` returns; None for anything else."""
        if not isinstance(data, Mapping) or not isinstance(data.get("label"), str):
            return None
        value = data.get("value")
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            return None
        known: Any = data.get("known", "")
        return cls(data["label"], value, str(data.get("unit", "")), known)
