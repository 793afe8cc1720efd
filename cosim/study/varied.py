"""The scenario of one run: the base with what is set for all, and what the axes move."""

from __future__ import annotations

import copy
import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.scenario import Scenario, give_way, put, split
from cosim.study.consistency import Place, nowhere
from cosim.study.expression import Expression
from cosim.study.schema import Axis, GridAxis, Study


@dataclass(frozen=True)
class AxisSetter:
    """Sets in a scenario what one axis moves."""

    places: tuple[str, ...]
    expressions: tuple[Expression | None, ...]
    zipped: bool

    @classmethod
    def of(cls, axis: Axis) -> AxisSetter:
        """Of an axis."""
        texts = axis.apply or {}
        return cls(
            axis.places,
            tuple(Expression(texts[p]) if p in texts else None for p in axis.places),
            isinstance(axis, GridAxis) and axis.rows is not None,
        )

    def set_values(self, data: dict[str, Any], value: Any) -> None:
        """Put the value, or what it becomes, into every place."""
        for i, (place, expression) in enumerate(zip(self.places, self.expressions, strict=True)):
            own = value[i] if self.zipped else value
            put(
                data,
                split(place),
                copy.deepcopy(own) if expression is None else expression(own),
                place,
            )


class Variations:
    """From a run's values to its scenario.

    Parameters
    ----------
    base : the scenario that is varied, without the study's `set`.
    where : a key of the study stands, for messages.

    Raises
    ------
    InputError : a path of `set` that leads nowhere, or a value that does not fit there.
    """

    def __init__(self, study: Study, base: Scenario, where: Place = nowhere) -> None:
        self._setters = [AxisSetter.of(axis) for axis in study.vary]
        data = base.model_dump(by_alias=True, exclude_unset=True)
        self._known = base.model_dump(by_alias=True)
        self._asked = _of_design(place for setter in self._setters for place in setter.places)
        give_way(data, _of_design(study.set))
        for place, value in study.set.items():
            check_place(self._known, place, where("set", place))
            put(data, split(place), copy.deepcopy(value), place)
        # what only comes with an axis is not there yet: judged with the first run's values
        self._data = data

    def data(self, values: Iterable[Any]) -> dict[str, Any]:
        """The scenario with these values of the axes, not validated."""
        data = copy.deepcopy(self._data)
        give_way(data, self._asked)
        for setter, value in zip(self._setters, values, strict=True):
            setter.set_values(data, value)
        return data

    def scenario(self, values: Iterable[Any]) -> Scenario:
        """The same, validated.

        Raises
        ------
        InputError : a value that is not allowed where it is put.
        """
        data = self.data(values)
        try:
            return Scenario.model_validate(data)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"])
            raise InputError(
                "the varied scenario is not allowed",
                where=where,
                expected=str(first["msg"]).removeprefix("Input should be "),
                got=repr(first["input"])[:200],
            ) from error

    def check_axis(self, axis: Axis, fmus: Mapping[str, FmuDescription], where: str) -> None:
        """See that every place of an axis is one that a scenario has.

        Raises
        ------
        InputError : it leads nowhere; says the nearest names.
        """
        for place in axis.places:
            check_place(self._known, place, where)
            check_parameter(place, fmus, where)


def _of_design(places: Iterable[str]) -> set[str]:
    """Keys of [design] among these places."""
    paths = [split(place) for place in places]
    return {str(path[1]) for path in paths if path[0] == "design" and len(path) > 1}


_FREE = ("links", "components")
"""Tables whose keys are the user's own names."""


def check_place(known: Mapping[str, Any], place: str, where: str) -> None:
    """See that a path leads somewhere in a scenario with all its keys, defaults included.

    Parameters of a component are the FMU's affair (`check_parameter`), and what lies inside a
    key that has no value yet is judged with the value.

    Raises
    ------
    InputError : the first key on the way that does not exist, and those that do.
    """
    here: Any = known
    way = ""
    for key in split(place):
        if here is None or way.endswith(".parameters"):
            return
        if isinstance(key, int):
            if not isinstance(here, list) or key >= len(here):
                size = len(here) if isinstance(here, list) else 0
                raise InputError(
                    f"{place} leads nowhere",
                    where=where,
                    expected=f"a place in {way}, which has {size}",
                    got=f"[{key}]",
                )
            here, way = here[key], f"{way}[{key}]"
            continue
        if not isinstance(here, dict):
            raise InputError(f"{place} leads nowhere", where=where, expected=f"{way} to be a table")
        if key not in here:
            if way in _FREE and place == f"{way}.{key}":
                return  # one more, given whole
            near = difflib.get_close_matches(key, list(here), n=3, cutoff=0.5)
            raise InputError(
                f"{place} leads nowhere",
                where=where,
                expected=f"{way or 'a scenario'} has {', '.join(here) or 'nothing'}",
                got=repr(key),
                hint=f"did you mean {' or '.join(near)}?" if near else None,
            )
        here, way = here[key], f"{way}.{key}" if way else key


def check_parameter(place: str, fmus: Mapping[str, FmuDescription], where: str) -> None:
    """See that a parameter that a path sets exists in its component's FMU.

    Raises
    ------
    InputError : it does not; says the nearest names.
    """
    match split(place):
        case ("components", str(component), "parameters", str(name)) if component in fmus:
            fmus[component].port(name, where=f"{where}: component {component!r}")


def as_cell(value: Any) -> Any:
    """A value of an axis as a cell of the table: numbers, words and truths; the rest as JSON."""
    if isinstance(value, (bool, int, float, str)):
        return value
    return json.dumps(value, sort_keys=True)
