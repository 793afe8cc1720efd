"""Systems by name (`paper`, `auv`) or from a TOML file, with the settings of their design."""

from __future__ import annotations

from cosim.core import InputError
from cosim.hinf.auv import DEFAULT_K1, DEFAULT_K2, auv_system
from cosim.hinf.system_toml import NamedSystem, load_system
from cosim.models import (
    Delay as Delay,  # noqa: PLC0414 - the face of this package offers it
    DelaySystem as DelaySystem,  # noqa: PLC0414 - the same
    paper_example,
)

BUILT_IN_SYSTEMS = ("paper", "auv")


def system_by_name(name: str) -> NamedSystem:
    """Return a built-in system, or the one in a `.toml` file.

    Raises
    ------
    InputError : no such system, or a file that does not hold one.
    """
    if name == "paper":
        return NamedSystem(paper_example.system(), (paper_example.K1,), (paper_example.K2,))
    if name == "auv":
        return NamedSystem(auv_system(), DEFAULT_K1, DEFAULT_K2)
    if not name.endswith(".toml"):
        raise InputError.unknown("system", name, (*BUILT_IN_SYSTEMS, "FILE.toml"))
    return load_system(name)
