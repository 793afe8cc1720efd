"""The plant that a design was made for, as variables of its FMU: the note `plant` of a design file.

A linear model is about deviations from a trim. This note says which outputs, inputs and parameters
of the plant's FMU they are, so that a run can compare what flies with what was designed for, and
measure z, w and the envelope. No proof depends on it: what is proved is the linear system of the
certificate; the note says how the plant is seen as that system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError


@dataclass(frozen=True, eq=False)
class LinearSignals:
    """A vector of the linear model, from variables of the plant: map (values - trim).

    Attributes
    ----------
    names : of variables, (k,).
    trim : their values at the trim, (k,).
    map : (n, k); None: the identity.
    """

    names: tuple[str, ...]
    trim: tuple[float, ...]
    map: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        wide = len(self.names) if self.map is None else self.map.shape[1]
        if not len(self.names) == len(self.trim) == wide:
            raise ValueError(
                f"expected as many values and columns as names, {len(self.names)}; got "
                f"{len(self.trim)} and {wide}"
            )

    @property
    def size(self) -> int:
        """Number of entries of the vector."""
        return len(self.names) if self.map is None else len(self.map)

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        mapped = {} if self.map is None else {"map": self.map.tolist()}
        return {"names": list(self.names), "trim": list(self.trim), **mapped}

    @classmethod
    def from_json(cls, data: Any, where: str) -> LinearSignals:
        """Read what `to_json` returns; InputError for anything else."""
        try:
            rows = data.get("map")
            return cls(
                tuple(str(name) for name in data["names"]),
                tuple(float(value) for value in data["trim"]),
                None
                if rows is None
                else np.array(rows, dtype=float).reshape(-1, len(data["names"])),
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(
                "not a vector of the linear model",
                where=where,
                expected="names, trim and optionally map",
                got=str(error),
            ) from error


class Difference(NamedTuple):
    """A parameter of a component with another value than it was designed for.

    value : None where the component does not have it.
    """

    parameter: str
    value: float | None
    designed: float


def differences_from(
    designed: Mapping[str, float], parameters: Mapping[str, float | None]
) -> list[Difference]:
    """Return the parameters that are not as designed."""
    own = ((name, parameters.get(name), value) for name, value in designed.items())
    return [Difference(*one) for one in own if one[1] is None or one[1] != one[2]]


@dataclass(frozen=True, eq=False)
class DesignedPlant:
    """How the FMU of a plant is seen as the linear system of a design.

    Attributes
    ----------
    state, control, disturbance : x, u and w of Eq. (7).
    parameters : name -> the value that the plant must have; a delay may be shorter.
    trim : state of the plant -> its value at the trim, those that are not controlled as well.
    envelope : variable -> its value at the trim, and the greatest deviation from it for which the
        uncertainty covers the plant.
    neglected : what the linear model leaves out, a sentence each.
    source : the text of the file that the plant comes from.
    model : what its FMU is made from, as `plant_record` returns it; empty in older files.
    thrust_map : (k, m) commands for a control, of which `control.map` is the inverse.
    envelope_share : of the envelope in the vehicle's file, what the design is proved for.
    """

    state: LinearSignals
    control: LinearSignals
    disturbance: LinearSignals
    parameters: Mapping[str, float]
    trim: Mapping[str, float] = field(default_factory=dict)
    envelope: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    neglected: tuple[str, ...] = ()
    source: str = ""
    model: Mapping[str, Any] = field(default_factory=dict)
    thrust_map: tuple[tuple[float, ...], ...] = ()
    envelope_share: float = 1.0

    @property
    def at_rest(self) -> dict[str, float]:
        """The parameters `initial.*` of the plant at its trim, where they exist."""
        return {f"initial.{name}": value for name, value in self.trim.items()}

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        return {
            "state": self.state.to_json(),
            "control": self.control.to_json(),
            "disturbance": self.disturbance.to_json(),
            "parameters": dict(self.parameters),
            "trim": dict(self.trim),
            "envelope": {name: list(pair) for name, pair in self.envelope.items()},
            "neglected": list(self.neglected),
            "source": self.source,
            "model": dict(self.model),
            "thrust_map": [list(row) for row in self.thrust_map],
            **({} if self.envelope_share == 1.0 else {"envelope_share": self.envelope_share}),
        }

    @classmethod
    def from_json(cls, data: Any, where: str) -> DesignedPlant:
        """Read what `to_json` returns; InputError for anything else."""
        if not isinstance(data, dict):
            raise InputError("not a note about a plant", where=where, got=type(data).__name__)
        vectors = {
            key: LinearSignals.from_json(data.get(key), f"{where}.{key}")
            for key in ("state", "control", "disturbance")
        }
        try:
            return cls(
                **vectors,
                parameters={str(k): float(v) for k, v in data["parameters"].items()},
                trim={str(k): float(v) for k, v in data["trim"].items()},
                envelope={k: (float(c), float(b)) for k, (c, b) in data["envelope"].items()},
                neglected=tuple(map(str, data["neglected"])),
                source=str(data["source"]),
                model=dict(data.get("model", {})),
                thrust_map=tuple(tuple(map(float, row)) for row in data.get("thrust_map", [])),
                envelope_share=float(data.get("envelope_share", 1.0)),
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise InputError(
                "not a note about a plant",
                where=where,
                expected="parameters, trim, envelope, neglected, source",
                got=str(error),
            ) from error
