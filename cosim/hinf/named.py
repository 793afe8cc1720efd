"""Systems by name (`paper`, `auv`) or from a TOML file, with their k1 and k2."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cosim.errors import InputError
from cosim.hinf.auv import DEFAULT_K1, DEFAULT_K2, auv_system
from cosim.hinf.files import load_system
from cosim.models import paper_example
from cosim.models.delay_system import DelaySystem

BUILT_IN = ("paper", "auv")


@dataclass(frozen=True)
class NamedSystem:
    """A system and the k1, k2 (one per delay) to start from."""

    system: DelaySystem
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    gamma: float | None = None


def system_by_name(name: str) -> NamedSystem:
    """A built-in system, or a `.toml` file.

    Raises
    ------
    InputError : no such system, or a file that does not hold one.
    """
    if name == "paper":
        return NamedSystem(paper_example.system(), (paper_example.K1,), (paper_example.K2,))
    if name == "auv":
        return NamedSystem(auv_system(), DEFAULT_K1, DEFAULT_K2)
    if not name.endswith(".toml"):
        raise InputError.unknown("system", name, (*BUILT_IN, "FILE.toml"))
    file = load_system(Path(name))
    n = len(file.system.delays)
    # k1 = -k2 is where a search starts; one second is a scale like any other
    k2 = tuple(file.k2) if file.k2 is not None else (1.0,) * n
    k1 = tuple(file.k1) if file.k1 is not None else tuple(-value for value in k2)
    return NamedSystem(file.system, k1, k2, file.gamma)
