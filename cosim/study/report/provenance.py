"""Where the results of a study come from, in words: versions, hashes, seeds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def provenance_of(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return label and value of each fact of a manifest."""
    return list(_facts(manifest))


def _facts(manifest: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    scenario = manifest.get("scenario") or {}
    yield "scenario", str(scenario.get("name", ""))
    yield "FMUs", str(manifest.get("flavour", ""))
    for key, seed in (manifest.get("seeds") or {}).items():
        yield f"seed of the {key}", str(seed)
    for fmu, sha256 in (manifest.get("fmus") or {}).items():
        yield f"SHA-256 of {fmu}", str(sha256)
    for part, sha256 in (manifest.get("parts") or {}).items():
        yield f"hash of the {part}", str(sha256)
    yield "hash of all that the results depend on", str(manifest.get("digest", ""))
    for name, version in (manifest.get("versions") or {}).items():
        yield name, str(version)
    loop = manifest.get("stability") or {}
    for key, label in (
        ("gamma", "bound γ of the design (certified)"),
        ("certified_age", "age that the design allows [s] (certified)"),
        ("exact_margin", "exact delay margin [s] (computed)"),
    ):
        if loop.get(key) is not None:
            yield label, f"{loop[key]:.6g}"
