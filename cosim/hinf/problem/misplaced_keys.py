"""What is meant by keys that the file of a system does not have, or has elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from cosim.hinf.certificate import BLOCKS, MATRICES
from cosim.hinf.problem.design_constraints import KEYS as DESIGN_CONSTRAINT_KEYS

_OF_DESIGN = ("k1", "k2", "gamma", *DESIGN_CONSTRAINT_KEYS)
_OF_A_DELAY = ("feedback", "any_age", "least_age", "rate", "sampled")
_MEANT: Mapping[str, str] = {
    "tau": "the delay is d, in seconds",
    "delay": "the delay is d, in seconds",
    "h": "the delay is d, in seconds",
    "Ad": "the matrix of the delayed state is A1",
    "A_d": "the matrix of the delayed state is A1",
    "A2": "several delays are tables [[system.delays]], each with A and d",
    "Bu": "the matrix of the control u is B",
    "Bw": "the matrix of the disturbance w is C",
    "B1": "did you mean C, the matrix of the disturbance w, or B, that of the control u?",
    "B2": "did you mean B, the matrix of the control u, or C, that of the disturbance w?",
    "C1": "did you mean D, the matrix of the state in z?",
    "D11": "did you mean D1, the matrix of the disturbance in z?",
    "D12": "did you mean D2, the matrix of the control in z?",
    "K": "a gain is given to a command: cosim analyse FILE --gain '[[...]]'",
}
IN_SYSTEM: Final[Mapping[str, str]] = MappingProxyType(
    {
        **_MEANT,
        **dict.fromkeys(_OF_DESIGN, "it belongs into the table [design]"),
        **dict.fromkeys(_OF_A_DELAY, "it belongs to a delay, into a table [[system.delays]]"),
        "measurements": "a measurement is a table [[measurements]] of its own, beside [system]",
        "observer": "it is a table of its own, [observer], beside [system]",
    }
)
"""Key of [system] that does not exist -> what to do."""
AT_THE_TOP: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(
            (*MATRICES, "d", "A1", "H1", "name", BLOCKS, *_MEANT),
            "the matrices belong into a table: put the line [system] above them",
        ),
        **dict.fromkeys(_OF_DESIGN, "it belongs into the table [design]"),
        "delays": "a delay is a table [[system.delays]]",
        "integral": "integral action is the table [system.integral]",
        "measurement": "a measurement is a table [[measurements]]",
        "sensors": "a sensor is a table [[measurements]]",
    }
)
IN_DESIGN: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys((*MATRICES, "d", "A1", "H1"), "it belongs into the table [system]"),
        "weights": "weights of the outputs z belong into [system]",
        "gain": "a gain is given to a command: cosim analyse FILE --gain '[[...]]'",
    }
)
OTHER_FILES: Final[Mapping[str, str]] = MappingProxyType(
    {
        ".json": "a design has its system inside: cosim certificate check {file} shows and proves "
        "it, cosim fmu controller {file} makes its FMU",
        ".mat": "matrices are written into a TOML file, or given from Python: cosim.DelaySystem",
        ".fmu": "of an FMU no system can be read: its matrices are written into a TOML file",
    }
)
"""Files that are no systems, and what to do with them."""
