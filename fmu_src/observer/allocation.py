"""The maps between controls and commands, where they differ: thruster allocation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cosim.core import InputError

_NEAR = 1e-6  # maps are often given with six digits


def maps_between(
    thrust_map: Sequence[Sequence[float]],
    allocation: Sequence[Sequence[float]],
    controls: int,
    commands: int,
) -> dict[str, list[list[float]]]:
    """Return `thrust_map` (r, m) and `allocation` (m, r); nothing where neither is given.

    Where one is given, the other is its pseudo-inverse: of all commands that give a control, those
    with the least sum of squares.

    Raises
    ------
    InputError : shapes that do not fit, or commands that do not give the control they are for.
    """
    shapes = {"thrust_map": (commands, controls), "allocation": (controls, commands)}
    given = {"thrust_map": thrust_map, "allocation": allocation}
    found = {name: np.array(m, dtype=float) for name, m in given.items() if len(m)}
    if not found and controls != commands:
        raise InputError(
            "these outputs need an allocation",
            expected=f"{controls} outputs, one per control",
            got=str(commands),
        )
    for name, matrix in found.items():
        if matrix.shape != shapes[name]:
            raise InputError(
                f"the {name} does not fit", expected=str(shapes[name]), got=str(matrix.shape)
            )
    if not found:
        return {}
    for name, other in (("thrust_map", "allocation"), ("allocation", "thrust_map")):
        if name not in found:
            found[name] = np.linalg.pinv(found[other])
    off = float(np.abs(found["allocation"] @ found["thrust_map"] - np.eye(controls)).max())
    if not off <= _NEAR:
        raise InputError(
            "the commands do not give the control that they are for",
            where="allocation",
            expected="allocation @ thrust_map = I",
            got=f"{off:.3g} off",
            hint="an actuator, or a combination of several, for every control",
        )
    return {name: found[name].tolist() for name in shapes}
