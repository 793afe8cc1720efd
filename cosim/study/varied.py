"""The scenario of one run: the base scenario with the study's `set` and the values of the axes."""

from __future__ import annotations

import copy
import difflib
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ValidationError

from cosim.core import InputError, Origin, did_you_mean, refusals
from cosim.fmu import FmuDescription
from cosim.scenario import ScenarioPart, give_way, put, split
from cosim.study.consistency import Place, nowhere
from cosim.study.schema import Axis, GridAxis, Study, of_x


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

    def __init__(self, study: Study, base: ScenarioPart, where: Place = nowhere) -> None:
        self._axes = study.vary
        self._expressions = [
            {place: of_x(text) for place, text in (axis.apply or {}).items()} for axis in study.vary
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
        self._first: ScenarioPart | None = None
        self._touched: dict[tuple[str, ...], list[int]] = {}
        for number, axis in enumerate(study.vary):
            for place in axis.places:
                axes = self._touched.setdefault(_part_of(place), [])
                if number not in axes:
                    axes.append(number)
        self._parts: dict[tuple[str, ...], dict[str, Any]] = {path: {} for path in self._touched}

    def scenario(self, values: Sequence[Any]) -> ScenarioPart:
        """Return the scenario with these values of the axes, validated.

        Parts that no axis touches, or that had the same values before, are the same objects.

        Raises
        ------
        InputError : a value is not allowed in its place.
        """
        first = self._first
        if first is None:
            first = self._first = self._validated(values)
        update: dict[str, Any] = {}
        for path, axes in self._touched.items():
            part = self._part(first, path, axes, values)
            key, *inside = path
            update[key] = (
                {**update.get(key, getattr(first, key)), inside[0]: part} if inside else part
            )
        return first.model_copy(update=update) if update else first

    def _part(
        self, first: ScenarioPart, path: tuple[str, ...], axes: Sequence[int], values: Sequence[Any]
    ) -> Any:
        """Return a part of the scenario with these values, validated by itself where it can be."""
        known = self._parts[path]
        key = repr([values[i] for i in axes])
        if key not in known:
            if len(known) >= _PARTS_KEPT:
                known.clear()
            part = self._part_alone(_at(first, path), path, values)
            # a refused value is not kept: it is refused again
            known[key] = _at(self._validated(values), path) if part is None else part
        return known[key]

    def _part_alone(self, like: Any, path: tuple[str, ...], values: Sequence[Any]) -> Any:
        """Validate a part that is of the type of `like`; None if it cannot be, or is refused."""
        if not isinstance(like, BaseModel) or path[0] == "design":
            return None
        data: Any = {}
        here: Any = data
        mine: Any = self._data
        for name in path:
            mine = mine.get(name) or {}
            here = here.setdefault(name, copy.deepcopy(mine) if name == path[-1] else {})
        try:
            self._put(data, values, path)
            return type(like).model_validate(here)
        except (ValidationError, InputError):
            return None

    def _put(
        self, data: dict[str, Any], values: Sequence[Any], within: tuple[str, ...] = ()
    ) -> None:
        """Put the values of the axes in their places, all or those within a part."""
        for axis, expressions, value in zip(self._axes, self._expressions, values, strict=True):
            zipped = isinstance(axis, GridAxis) and axis.rows is not None
            for i, place in enumerate(axis.places):
                way = split(place)
                if tuple(way[: len(within)]) == within:
                    own = value[i] if zipped else value
                    found = expressions.get(place)
                    put(
                        data,
                        way,
                        copy.deepcopy(own) if found is None else found.number(x=own),
                        place,
                    )

    def _validated(self, values: Sequence[Any]) -> ScenarioPart:
        data = copy.deepcopy(self._data)
        give_way(data, self._asked)
        self._put(data, values)
        try:
            return ScenarioPart.model_validate(data)
        except ValidationError as error:
            first = refusals(ScenarioPart, error, data, Origin(()))[0]
            first.what = "the varied scenario is not allowed"
            first.where = ".".join(map(str, error.errors(include_url=False)[0]["loc"]))
            first.args = (first.text(),)
            raise first from error

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
_PARTS_KEPT = 1024
"""So many values of a part of the scenario are kept; grids and replicates come to them again."""


def _part_of(place: str) -> tuple[str, ...]:
    """Return the path of the part that a place belongs to: a link, a component, another table."""
    way = split(place)
    return tuple(str(key) for key in way[: 2 if way[0] in _FREE else 1])


def _at(scenario: ScenarioPart, path: tuple[str, ...]) -> Any:
    """Return the part at a path."""
    found = getattr(scenario, path[0])
    return found[path[1]] if len(path) > 1 else found


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
                    hint=f"places are counted from 0: {way}[0]",
                )
            here, way = here[key], f"{way}[{key}]"
            continue
        if not isinstance(here, dict):
            raise InputError(
                f"{place} leads nowhere",
                where=where,
                expected=f"{way} to be a table",
                hint=f"the path ends there: {way}",
            )
        if key not in here:
            if way in _FREE and place == f"{way}.{key}":
                return  # a new entry
            near = difflib.get_close_matches(key, list(here), n=3, cutoff=0.5)
            raise InputError(
                f"{place} leads nowhere",
                where=where,
                expected=f"{way or 'a scenario'} has {', '.join(here) or 'nothing'}",
                got=repr(key),
                hint=did_you_mean(near or list(here)[:3]),
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
