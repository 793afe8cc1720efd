"""Systems by name (`paper`, `auv`) or from a TOML file, with what they say of their design."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from cosim.core import InputError
from cosim.hinf.auv import DEFAULT_K1, DEFAULT_K2, auv_system
from cosim.hinf.design_constraints import DesignConstraints
from cosim.hinf.system_toml import load_system
from cosim.models import (
    Delay as Delay,  # noqa: PLC0414 - the face of this package offers it
    DelaySystem as DelaySystem,  # noqa: PLC0414 - the same
    paper_example,
)

BUILT_IN_SYSTEMS = ("paper", "auv")


@dataclass(frozen=True)
class NamedSystem:
    """A system, and what its design starts from and is to meet.

    k1, k2 : one number per delay; None: to be searched.
    gamma : None: the least.
    weights : of the rows of z, which `system` has; None where there are none.
    unweighted : the system before these weights; None where there are none.
    design_constraints : beside gamma.
    """

    system: DelaySystem
    k1: tuple[float, ...] | None
    k2: tuple[float, ...] | None
    gamma: float | None = None
    weights: tuple[float, ...] | None = None
    unweighted: DelaySystem | None = None
    design_constraints: DesignConstraints = field(default_factory=DesignConstraints)


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
        raise InputError.unknown("system", name, (*BUILT_IN_SYSTEMS, "FILE.toml"))
    file = load_system(Path(name))
    before = None if file.weights is None else file.unweighted
    return NamedSystem(
        file.system, file.k1, file.k2, file.gamma, file.weights, before, file.design_constraints
    )
