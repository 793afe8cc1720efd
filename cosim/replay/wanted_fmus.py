"""The FMUs that a trace names by their hash, built where the catalogue has them."""

from __future__ import annotations

import hashlib
from pathlib import Path

from cosim.core import CosimError
from cosim.fmu import CATALOGUE, FMI_VERSION, ensure_fmu
from cosim.scenario import FmuCache


def build_wanted_fmus(fmu_cache: FmuCache) -> None:
    """Build what the catalogue has until every FMU that is wanted is below the hangar's root.

    The flavour that flew is not written down but in the hash: the hangar's own is tried first.
    What is not found remains so; who looks for it says what is missing.
    """
    there = {_sha256(path) for path in fmu_cache.root.rglob("*.fmu") if path.is_file()}
    flavours = [fmu_cache.flavour, *(f for f in FMI_VERSION if f != fmu_cache.flavour)]
    for name, wanted in fmu_cache.wanted.items():
        if name not in CATALOGUE or not wanted:
            continue
        for flavour in flavours:
            if wanted in there:
                break
            try:
                built = ensure_fmu(name, fmu_cache.root, flavour=flavour).path
            except (CosimError, OSError):  # no compiler here, or no room: not this flavour
                continue
            there.add(_sha256(built))


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
