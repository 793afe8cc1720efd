"""The scenario of one run: the base scenario with the study's `set` and the values of the axes."""

from __future__ import annotations

import copy
import difflib
import json
from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from cosim.core import InputError
from cosim.fmu import FmuDescription
from cosim.scenario import Scenario, give_way, put, split
from cosim.study.consistency import Place, nowhere
from cosim.study.expression import Expression
from cosim.study.schema import Axis, GridAxis, Study


class Variations:
    """Makes the scenario of a run from the values of the axes.

    Parameters
    ----------
    base : the scenario that is varied, without the study's `set`.
    where : gives the place of a key of the study, for messages.

    Raises
    ------
    InputError : a path of `set` does not exist, or its value does not fit.
    """

    def __init__(self, study: Study, base: Scenario, where: Place = nowhere) -> None:
        self._axes = study.vary
        self._expressions = [
            {place: Expression(text) for place, text in (axis.apply or {}).items()}
            for axis in study.vary
        ]
        data = base.model_dump(by_alias=True, exclude_unset=True)
        self._known = base.model_dump(by_alias=True)
        self._asked = _of_design(place for axis in study.vary for place in axis.places)
        give_way(data, _of_design(study.set))
        for place, value in study.set.items():
            check_place(self._known, place, where("set", place))
            put(data, split(place), copy.deepcopy(value), place)
        # entries that an axis adds are not there yet: they are checked with the first run's values
        self._data = data

    def data(self, values: Iterable[Any]) -> dict[str, Any]:
        """Return the scenario with these values of the axes, not validated."""
        data = copy.deepcopy(self._data)
        give_way(data, self._asked)
        for axis, expressions, value in zip(self._axes, self._expressions, values, strict=True):
            zipped = isinstance(axis, GridAxis) and axis.rows is not None
            for i, place in enumerate(axis.places):
                own = value[i] if zipped else value
                known = expressions.get(place)
                put(data, split(place), copy.deepcopy(own) if known is None else known(own), place)
        return data

    def scenario(self, values: Iterable[Any]) -> Scenario:
        """Return the scenario with these values of the axes, validated.

        Raises
        ------
        InputError : a value is not allowed in its place.
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
        """Check that the scenario has every place of an axis.

        Raises
        ------
        InputError : it has not; the message gives similar names.
        """
        for place in axis.places:
            check_place(self._known, place, where)
            check_parameter(place, fmus, where)


def _of_design(places: Iterable[str]) -> set[str]:
    """Return the keys of [design] among these places."""
    paths = [split(place) for place in places]
    return {str(path[1]) for path in paths if path[0] == "design" and len(path) > 1}


_FREE = ("links", "components")
"""Tables whose keys are names that the user chooses."""


def check_place(known: Mapping[str, Any], place: str, where: str) -> None:
    """Check that a path exists in a scenario with all its keys, defaults included.

    Parameters of a component are checked by `check_parameter`, and entries of a key without a
    value are checked with the value.

    Raises
    ------
    InputError : the first key of the path that does not exist, and the keys that do.
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
                return  # a new entry
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
    """Check that the FMU of a component has the parameter that a path sets.

    Raises
    ------
    InputError : it has not; the message gives similar names.
    """
    match split(place):
        case ("components", str(component), "parameters", str(name)) if component in fmus:
            fmus[component].port(name, where=f"{where}: component {component!r}")


def as_cell(value: Any) -> Any:
    """Return a value of an axis as a cell of the table: as it is, or a list or table as JSON."""
    if isinstance(value, (bool, int, float, str)):
        return value
    return json.dumps(value, sort_keys=True)
