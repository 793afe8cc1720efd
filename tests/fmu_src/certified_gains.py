"""The certificates that controllers are built with; run as a program, it makes them anew.

    python tests/fmu_src/certified_gains.py

A design takes a solver, so that FMUs are built from the files; the tests prove what is in them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import fmu_src.hinf_controller
from cosim.hinf import analyse, certificate_bytes, design, system_by_name
from cosim.models.paper_example import PRINTED_K

FOLDER = Path(str(fmu_src.hinf_controller.__file__)).parent


def vehicle() -> dict[str, Any]:
    """The design of the built-in system `auv`."""
    named = system_by_name("auv")
    return design(named.system, named.k1, named.k2).certificate


def paper() -> dict[str, Any]:
    """What Theorem 1 proves of the printed gain of section 5."""
    certificate = analyse(system_by_name("paper").system, [PRINTED_K]).certificate
    assert certificate is not None
    return certificate


MADE_BY = {"auv.json": vehicle, "paper.json": paper}

if __name__ == "__main__":
    for name, make in MADE_BY.items():
        (FOLDER / name).write_bytes(certificate_bytes(make()))
