"""Check what the schema of a vehicle file cannot: terms that fit, numbers that can be."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import NoReturn

from cosim.core import InputError, counted, line_of
from cosim.models import (
    FORCES,
    VELOCITIES,
    Derivative,
    VehicleEquations,
    axes_of,
    derivative_named,
    effect_of,
)
from cosim.vehicle.parameters import (
    hydro_derivatives,
    needs_density,
    parameters_of,
    terms_of,
)
from cosim.vehicle.schema import VehicleFile

_UNIT_VECTOR = 0.01
"""Largest deviation of the length of a unit vector from 1."""
_WEIGHT = (0.5, 2.0)
"""Weight over mass times gravity, and buoyancy over weight, that can be meant."""
_AS_THEY_ACT = "forces are given as they act on the vehicle: this one is negative"


def motion_names(file: VehicleFile) -> tuple[str, ...]:
    """Return the FMI names of eta, with Euler angles, and nu."""
    level = file.degrees_of_freedom == 4
    angles = ("psi",) if level else ("phi", "theta", "psi")
    letters = [VELOCITIES[i] for i in axes_of(file.degrees_of_freedom)]
    eta = [f"eta.{a}" for a in ("x", "y", "z", *angles)]
    return (*eta, *(f"nu.{letter}" for letter in letters))


class Faults:
    """Checks one vehicle file; the first fault is raised with its line."""

    def __init__(self, file: VehicleFile, text: str, where: str) -> None:
        self._file, self._text, self._where = file, text, where
        self._level = file.degrees_of_freedom == 4
        self._axes = axes_of(file.degrees_of_freedom)

    def check(self) -> None:
        """Raise the first fault.

        Raises
        ------
        InputError : a term that does not fit, or a number that cannot be.
        """
        for fault in self.all():
            raise fault

    def all(self) -> Iterator[InputError]:
        """Yield every fault, one for each part; what builds on others comes last."""
        names = self._file.hydro.__pydantic_extra__ or {}
        parts: list[Callable[[], object]] = [self._attitude, self._body]
        parts += [partial(self._derivative, name, "hydro", name) for name in names]
        parts += [self._hydro, self._hull]
        parts += [partial(self._thruster, i) for i in range(len(self._file.thrusters))]
        parts += [partial(self._fin, i) for i in range(len(self._file.fins))]
        known: set[str] = set()
        for group in ([*parts, self._actuators], [self._design], [self._mass]):
            for part in group:
                try:
                    part()
                except InputError as fault:
                    if str(fault) not in known:
                        known.add(str(fault))
                        yield fault
            if known:
                return

    def _attitude(self) -> None:
        file = self._file
        if self._level and file.attitude == "quaternion":
            self._refuse(
                "a vehicle in 4 degrees of freedom has a heading alone",
                "attitude",
                expected='attitude = "euler", or degrees_of_freedom = 6',
                got='"quaternion"',
            )

    def _refuse(
        self,
        what: str,
        *path: str | int,
        expected: str | None = None,
        got: str | None = None,
        hint: str | None = None,
    ) -> NoReturn:
        raise InputError(what, where=self._place(*path), expected=expected, got=got, hint=hint)

    def _place(self, *path: str | int) -> str:
        dotted = [part for key in path for part in str(key).split(".")]
        line = line_of(self._text, path) if path[0] != "envelope" else None
        if path[0] == "envelope":  # nu.u may stand without quotes
            line = max(line_of(self._text, path) or 1, line_of(self._text, dotted) or 1)
        keys = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in path)[1:]
        return f"{self._where}:{line}: {keys}" if line else f"{self._where}: {keys}"

    def _body(self) -> None:
        body = self._file.body
        full = isinstance(body.inertia[0], list)
        rows = body.inertia if full else []
        for i in range(len(rows)):
            for j in range(i):
                if rows[i][j] != rows[j][i]:  # type: ignore[index]
                    self._refuse(
                        "the inertia matrix is not symmetric",
                        *("body", "inertia"),
                        expected=f"entries ({i + 1},{j + 1}) and ({j + 1},{i + 1}) alike",
                        got=f"{rows[i][j]!r} and {rows[j][i]!r}",  # type: ignore[index]
                    )
        weight = body.mass * body.gravity if body.weight is None else body.weight
        pairs = (
            ("weight", weight, body.mass * body.gravity, "mass times gravity"),
            ("buoyancy", body.buoyancy or weight, weight, "the weight"),
        )
        for key, value, about, name in pairs:
            if not _WEIGHT[0] <= value / about <= _WEIGHT[1]:
                self._refuse(
                    f"the {key} is far from {name}",
                    *("body", key),
                    expected=f"about {about:.6g} N",
                    got=f"{value:.6g} N",
                    hint="weight and buoyancy are forces in newton",
                )
        self._needs("density", needs_density(self._file), "the prime system or a drag")
        self._needs("length", self._file.hydro.prime, "the prime system")

    def _needs(self, key: str, needed: bool, by: str) -> None:  # noqa: FBT001 - a fact, not a mode
        if needed and getattr(self._file.body, key) is None:
            self._refuse(f"the key 'body.{key}' is missing, which {by} needs", "body")

    def _hydro(self) -> None:
        hydro = self._file.hydro
        given: dict[str, str] = {}
        for name in hydro.__pydantic_extra__ or {}:
            d = self._derivative(name, "hydro", name)
            if d.name in given:
                self._refuse(f"{given[d.name]} and {name} are the same derivative", "hydro", name)
            given[d.name] = name
        derivatives = hydro_derivatives(self._file)
        for d, value in derivatives:
            self._pair(d, given)
            self._sign(d, value, given)
        linear = [d for d, _ in derivatives if len(d.factors) == 1 and not d.dot]
        if hydro.prime and linear and hydro.reference_speed is None:
            self._refuse(
                f"{linear[0].name} is linear: the prime system needs a speed for it",
                *("hydro", given[linear[0].name]),
                hint="reference_speed in [hydro], or a product with u: "
                f"{linear[0].name[:2]}u{linear[0].factors}",
            )
        if hydro.reference_speed is not None and not (hydro.prime and linear):
            self._refuse(
                "nothing depends on this speed",
                *("hydro", "reference_speed"),
                expected="prime = true and a linear derivative, such as X_u",
            )
        if hydro.coriolis_without and hydro.coriolis == "given":
            self._refuse(
                "there is no Coriolis matrix to leave entries out of",
                *("hydro", "coriolis_without"),
                expected='coriolis = "added-mass"',
                got='coriolis = "given"',
            )
        if hydro.current == "heading" and self._file.attitude == "quaternion":
            self._refuse(
                "a quaternion has no heading to turn the current by",
                *("hydro", "current"),
                expected='current = "attitude", or attitude = "euler"',
            )
        for name in hydro.fading:
            d = self._derivative(name, "hydro", "fading", name)
            if d not in linear:
                self._refuse(
                    f"{name} cannot fade",
                    *("hydro", "fading", name),
                    expected="a linear derivative of [hydro]"
                    + "".join(f", {each.name}" for each in linear),
                    got=name,
                )

    def _derivative(
        self, name: str, *path: str | int, fin: bool = False, prime: bool = False
    ) -> Derivative:
        """Return the derivative of a name that is one of this vehicle's."""
        d = derivative_named(name)
        if d is None or (d.angles == 0 if fin else d.angles > 0) or (fin and d.dot):
            known = "Y_uud, X_uudd" if fin else "X_udot, X_u, X_|u|u, Y_ur, ..."
            of = "a fin: products of up to two velocities with d or dd" if fin else "[hydro]"
            self._refuse(
                f"there is no key or derivative {name!r}",
                *path,
                expected=f"a derivative of {of}, such as {known}"
                + ("" if fin else f"; or {', '.join(self._hydro_keys())}"),
                hint=None if fin else _meant(name),
            )
        if prime and len(d.factors) != 2:
            self._refuse(
                f"{name} has no prime form",
                *path,
                expected="two velocities and the angle",
                got=name,
            )
        letters = {FORCES[d.row], *d.factors}
        absent = {f"{FORCES[i]}" for i in range(6) if i not in self._axes}
        absent |= {VELOCITIES[i] for i in range(6) if i not in self._axes}
        if letters & absent:
            self._refuse(
                f"{name} is a term of roll or pitch, which this vehicle does not have",
                *path,
                expected="rows X, Y, Z, N and velocities u, v, w, r, or degrees_of_freedom = 6",
                got=name,
            )
        return d

    def _hydro_keys(self) -> Iterable[str]:
        return type(self._file.hydro).model_fields

    def _pair(self, d: Derivative, given: dict[str, str]) -> None:
        column = VELOCITIES.index(d.factors) if d.dot else d.row
        if column == d.row:
            return
        other = f"{FORCES[column]}_{VELOCITIES[d.row]}dot"
        if other not in given:
            self._refuse(
                f"{d.name} is one of a pair of added masses, and the other is missing",
                *("hydro", given[d.name]),
                expected=other,
                hint=f"{other} is the same number in an ideal fluid; 0.0 if it is none",
            )

    def _sign(self, d: Derivative, value: float, given: dict[str, str]) -> None:
        velocity = VELOCITIES[d.row]
        damps = d.factors == velocity * len(d.factors) and (len(d.factors) == 1 or d.absolute)
        if not damps or value <= 0 or d.angles:
            return
        quadratic = f"{FORCES[d.row]}_|{velocity}|{velocity}"
        if not d.dot and len(d.factors) == 1 and quadratic in given:
            return
        self._refuse(
            f"{d.name} is positive: it {'takes mass away' if d.dot else 'drives the motion'}",
            *("hydro", given[d.name]),
            expected="a number < 0",
            got=repr(value),
            hint=_AS_THEY_ACT,
        )

    def _hull(self) -> None:
        flow = self._file.cross_flow
        if flow is None:
            return
        if flow.length is None and self._file.body.length is None:
            self._refuse(
                "the hull has no length", "cross_flow", expected="length, here or in [body]"
            )
        if flow.coupled != (flow.softening is not None):
            self._refuse(
                "coupled drag and the speed that softens it belong together",
                *("cross_flow", "softening" if flow.softening else "coupled"),
                expected="coupled = true and softening, such as 1e-6",
                got=f"coupled = {str(flow.coupled).lower()}, softening = {flow.softening}",
            )
        if flow.pitch == "opposite" and not flow.coupled:
            self._refuse(
                "this pitch moment is one of coupled drag",
                *("cross_flow", "pitch"),
                expected="coupled = true",
            )
        drag = (1.0, 1.0) if flow.drag == "hoerner" else tuple(flow.drag)
        if not any(drag) or (flow.coupled and not all(drag)):
            self._refuse(
                "a drag coefficient is zero",
                *("cross_flow", "drag"),
                expected="two numbers > 0 where coupled, else one at least",
                got=str(flow.drag),
            )

    def _actuators(self) -> None:
        seen: dict[str, str] = {}
        for table in ("thrusters", "fins"):
            for i, part in enumerate(getattr(self._file, table)):
                if part.name.lower() in seen:
                    self._refuse(
                        f"two actuators have the name {part.name!r}",
                        *(table, i, "name"),
                        expected="names that differ, in capitals and small letters alike",
                        got=f"{part.name} beside {seen[part.name.lower()]}",
                    )
                seen[part.name.lower()] = part.name
        loop = self._file.onboard_damping
        for letter in loop.rates if loop else ():
            if VELOCITIES.index(letter) not in self._axes:
                self._refuse(
                    f"this vehicle has no velocity {letter}",
                    *("onboard_damping", "rates"),
                    expected="u, v, w, r, or degrees_of_freedom = 6",
                    got=letter,
                )

    def _thruster(self, i: int) -> None:
        part = self._file.thrusters[i]
        pure = not any(part.direction)
        if pure and (any(part.position) or not any(part.moment)):
            self._refuse(
                "a thruster without direction is a moment alone",
                *("thrusters", i, "direction"),
                expected="a unit vector; or zeros, with moment and without position",
                got=str(part.direction),
            )
        if not pure:
            self._unit_vector(part.direction, "thrusters", i, "direction")
        effects = effect_of(part.direction, part.position, part.moment)
        if not any(FORCES.index(letter) in self._axes for letter in effects):
            self._refuse(
                f"{part.name} acts in roll and pitch alone, which this vehicle does not have",
                *("thrusters", i, "name"),
                expected="degrees_of_freedom = 6",
            )

    def _fin(self, i: int) -> None:
        fin = self._file.fins[i]
        parts = {"area": fin.area, "lift": fin.lift, "direction": fin.direction}
        missing = [key for key, value in parts.items() if value is None]
        if missing and (len(missing) < len(parts) or not fin.derivatives):
            self._refuse(
                f"the fin {fin.name} has no {' and no '.join(missing)}",
                *("fins", i, "name"),
                expected="area, lift and direction, or derivatives",
            )
        if missing and (fin.drag or any(fin.position)):
            key = "drag" if fin.drag else "position"
            self._refuse(f"{key} belongs to a fin with an area", *("fins", i, key))
        if fin.direction is not None:
            self._unit_vector(fin.direction, "fins", i, "direction")
            if fin.direction[0]:
                self._refuse(
                    "the lift of a fin is across x, its drag along it",
                    *("fins", i, "direction"),
                    expected="[0, y, z]",
                    got=str(fin.direction),
                )
        for name in fin.derivatives:
            path = ("fins", i, "derivatives", name)
            self._derivative(name, *path, fin=True, prime=self._file.hydro.prime)

    def _unit_vector(self, vector: Sequence[float], *path: str | int) -> None:
        if abs(math.hypot(*vector) - 1.0) > _UNIT_VECTOR:
            self._refuse(
                "not a unit vector",
                *path,
                expected="a length of 1",
                got=f"{vector}, of length {math.hypot(*vector):.6g}",
            )

    def _design(self) -> None:
        file = self._file
        equations = VehicleEquations(terms_of(file))
        names = [*dict.fromkeys([*equations.states, *motion_names(file)])]
        seen: set[str] = set()
        for i, sensor in enumerate(file.sensors):
            if sensor.name in seen:
                self._refuse(f"two sensors have the name {sensor.name!r}", "sensors", i, "name")
            seen.add(sensor.name)
            self._known("output", sensor.measures, names, "sensors", i, "measures")
            if isinstance(sensor.noise, list) and len(sensor.noise) != len(sensor.measures):
                self._refuse(
                    "not one noise per value",
                    *("sensors", i, "noise"),
                    expected=counted(len(sensor.measures), "number"),
                    got=str(len(sensor.noise)),
                )
        places = ("eta.x", "eta.y", "eta.z")
        for name, bound in file.envelope.items():
            self._known("state", [name], names, "envelope", name)
            if name in places:
                self._refuse(
                    f"{name} needs no bound: the equations do not depend on it", "envelope", name
                )
            number = isinstance(bound, int | float) and not isinstance(bound, bool)
            if not number or not math.isfinite(bound) or bound <= 0:
                self._refuse(
                    "not a bound", "envelope", name, expected="a number > 0", got=repr(bound)
                )
        control = file.control
        self._known("state", control.states or [], names, "control", "states")
        commands = equations.inputs[: len(file.thrusters) + len(file.fins)]
        for name in control.weights:
            known = [*names, *commands]
            self._known("state or command", [name], known, "control", "weights", name)

    def _known(
        self, kind: str, given: Sequence[str], names: Sequence[str], *path: str | int
    ) -> None:
        for name in given:
            if name not in names:
                raise InputError.unknown(kind, name, names, where=self._place(*path))
            if list(given).count(name) > 1:
                self._refuse(f"{name} is there twice", *path)

    def _mass(self) -> None:
        """Refuse a mass matrix that is not positive definite."""
        values = {p.name: p.value for p in parameters_of(self._file)}
        initial = {f"initial.quaternion.q{i}": float(i == 0) for i in range(4)}
        conditions = VehicleEquations(terms_of(self._file)).conditions({**values, **initial})
        for quantity, message in conditions:
            if not quantity > 0:
                self._refuse(
                    message,
                    "body",
                    expected="every pivot > 0",
                    got=f"{quantity:.6g}",
                    hint="mass and inertia against the added masses, which are negative numbers, "
                    "and against r_g",
                )


def _meant(name: str) -> str | None:
    """Return what a name that is no derivative may be meant for."""
    other = name.replace("'", "").replace("abs", "|")
    for old, new in (("dot_", "_"), ("_dot", "dot")):
        other = other.replace(old, new)
    letters = [c for c in other if c in VELOCITIES]
    if len(other) > 1 and other[0] in FORCES and other[1] != "_":
        letters = [c for c in other[1:].removesuffix("dot") if c in VELOCITIES]
        tail = "dot" if other.endswith("dot") else ""
        other = f"{other[0]}_{''.join(letters)}{tail}"
    return f"did you mean {other}?" if letters and derivative_named(other) else None
