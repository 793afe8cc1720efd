"""The certificates that controllers are built with; run as a program, it makes them anew.

    python tests/fmu_src/certified_gains.py

A design takes a solver, so that FMUs are built from the files; the tests prove what is in them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cosim.hinf import analyse, design, system_by_name
from cosim.hinf.certificate import certificate_bytes
from cosim.models import paper_example

ROOT = Path(__file__).parents[2]
VEHICLE = "cosim/scenario/library/designs/auv-1.25s.json"


def vehicle() -> dict[str, Any]:
    """The best proof of the gain of the built-in system `auv`, which the built-in scenarios fly.

    The gain is that of the file: solvers differ in its last digits, and it decides what flies.
    """
    pinned = json.loads((ROOT / VEHICLE).read_bytes())
    return (design(system_by_name("auv").system, gain=pinned["K"])).to_json()


def paper() -> dict[str, Any]:
    """What Theorem 1 proves of the printed gain of section 5."""
    certificate = analyse(
        system_by_name("paper").system, [paper_example.PRINTED_K], order=0
    ).certificate
    assert certificate is not None
    return certificate


MADE_BY = {
    VEHICLE: vehicle,
    "fmu_src/hinf_controller/paper.json": paper,
}

if __name__ == "__main__":
    for name, make in MADE_BY.items():
        data = make()
        saved = json.dumps(data, indent=1, allow_nan=False).encode() + b"\n"
        (ROOT / name).write_bytes(saved if "figures" in data else certificate_bytes(data))
