"""A certificate as the bytes that travel: one certificate, one SHA-256."""

from __future__ import annotations

import hashlib
import json
from typing import Any

_NOTES = ("figures", "made_for")
"""Keys of a saved design that are no part of its certificate."""


def certificate_bytes(data: dict[str, Any]) -> bytes:
    """A certificate, or a design that holds one, as JSON without notes: sorted, no spaces.

    Raises
    ------
    ValueError : a NaN or an infinity, which JSON does not have.
    """
    kept = {key: value for key, value in data.items() if key not in _NOTES}
    text = json.dumps(kept, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return text.encode() + b"\n"


def certificate_hash(data: dict[str, Any]) -> str:
    """SHA-256 of `certificate_bytes`, 64 hexadecimal digits."""
    return hashlib.sha256(certificate_bytes(data)).hexdigest()
