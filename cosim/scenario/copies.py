"""`count`, `each` and `[[for]]`: parts of a scenario that are there several times.

    [components.vehicle]            # vehicle_1, vehicle_2, vehicle_3
    fmu = "AuvPlant"
    count = 3
    parameters = { "initial.eta.y" = "{20 * i}" }

    [[for]]                         # whatever stands in it, once per vehicle
    each = ["alpha", "bravo"]
    connect = ["{each}.eta -> ship.{each} : {each}-up"]

Texts and keys of a copy have `{...}`: the name of the copy (`each`), its number from 1 (`i`), a key
of `each = [{ name = "alpha", depth = 5 }]`, or an expression of numbers among these. A text that is
nothing but braces becomes the value itself; `{{` is a brace. `[components.vehicle_2]` beside them
changes that copy. The copies are made before the scenario is validated: what runs, and stands in
the trace, is the scenario written out.
"""

from __future__ import annotations

import copy
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from cosim.core import NOWHERE, Copied, InputError, KeyPath, Origin, dotted
from cosim.scenario.binding import Meaning, bind
from cosim.scenario.expression import Expression, ExpressionError

MOST = 10_000
"""Most copies of one part."""
NAMED = ("components", "links")
"""Tables whose entries may have `count` or `each` of their own."""
_ASKED = ("each", "count", "as")
_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_HOLES = re.compile(r"\{\{|\}\}|\{([^{}]*)\}")


@dataclass
class _Copier:
    """Makes the copies of one scenario; `made` says where each comes from."""

    origin: Origin
    data: dict[str, Any]
    made: dict[KeyPath, Copied] = field(default_factory=dict)

    def wrong(self, what: str, path: KeyPath, label: str = "", **more: str | None) -> InputError:
        place = self.origin.place(path)
        where = dotted(path) if place is None else f"{place}{label}: {dotted(path)}"
        return InputError(what, where=where, **more)

    def named(self, table: str) -> None:
        """Make the copies of the entries of a table that have `count` or `each`."""
        parts = self.data.get(table)
        if not isinstance(parts, dict):
            return
        for name, part in list(parts.items()):
            if isinstance(part, dict) and ("count" in part or "each" in part):
                body = {k: v for k, v in part.items() if k not in _ASKED}
                del parts[name]
                pattern = name if "{" in name else f"{name}_{{{_placeholder(part)}}}"
                for known in self.loop(part, (table, name), {}):
                    self.add({table: {pattern: body}}, known, {(table, pattern): (table, name)})

    def every(self, loops: Any, at: KeyPath, known: Mapping[str, Any]) -> None:
        """Make the copies of `[[for]]`."""
        if not isinstance(loops, list) or not all(isinstance(one, dict) for one in loops):
            raise self.wrong("[[for]] is a list of tables", at, expected="[[for]] and each = [...]")
        for number, part in enumerate(loops):
            path = (*at, number)
            body = {k: v for k, v in part.items() if k not in (*_ASKED, "for")}
            if not body and "for" not in part:
                raise self.wrong("[[for]] repeats nothing", path, expected="[[for.connections]]")
            for values in self.loop(part, path, known):
                self.add(body, values, {(name,): (*path, name) for name in body})
                if "for" in part:
                    self.every(part["for"], (*path, "for"), values)

    def loop(
        self, part: Mapping[str, Any], path: KeyPath, known: Mapping[str, Any]
    ) -> Iterator[dict[str, Any]]:
        """Yield the values of the placeholders for each copy."""
        count, each, name = part.get("count"), part.get("each"), _placeholder(part)
        if (count is None) == (each is None):
            raise self.wrong("how often is this there?", path, expected="one of count and each")
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise self.wrong("not the name of a placeholder", (*path, "as"), got=repr(name))
        if each is None:
            if not isinstance(count, int) or isinstance(count, bool) or not 1 <= count <= MOST:
                expected = f"a whole number from 1 to {MOST}"
                raise self.wrong(
                    "so many copies cannot be made",
                    (*path, "count"),
                    expected=expected,
                    got=repr(count),
                )
            each = list(range(1, count + 1))
        if not isinstance(each, list) or not 1 <= len(each) <= MOST:
            expected = f"a list of names, numbers or tables, at most {MOST}"
            raise self.wrong(
                "each is no list of copies", (*path, "each"), expected=expected, got=repr(each)[:80]
            )
        for i, one in enumerate(each, 1):
            values = one if isinstance(one, dict) else {name: one}
            yield {**known, "i": i, **values}

    def add(self, body: Mapping[str, Any], known: Mapping[str, Any], sources: Any) -> None:
        """Add the tables of one copy to the scenario."""
        label = f" (copy {_label(known)})"
        for table, part in body.items():
            source = next(s for p, s in sources.items() if p[0] == table)
            if isinstance(part, dict) and table != "reference":
                here = self.data.setdefault(table, {})
                for name, entry in part.items():
                    at = (*source, name) if (table,) in sources else source
                    made = self.filled(name, at, label, known)
                    if not isinstance(here, dict):
                        raise self.wrong(f"{table!r} is no table", at, label)
                    to = (table, made)
                    again = to in self.made
                    self.made.setdefault(to, Copied(at, label))
                    own = self.table(entry, at, to, label, known)
                    there = here.get(made) if again else here.pop(made, None)
                    if isinstance(there, dict) and isinstance(own, dict):
                        own = self.joined(there, own, to, at, label, again=again)
                    here[made] = own
                continue
            if not isinstance(part, dict | list):
                raise self.wrong(f"{table!r} is not repeated", source, expected="tables and lists")
            before = self.data.setdefault(table, [])
            if isinstance(before, dict):  # [reference], and more of them
                self.data[table] = before = [before]
            for k, entry in enumerate(part if isinstance(part, list) else [part]):
                at = (*source, k) if isinstance(part, list) else source
                to = (table, len(before))
                self.made[to] = Copied(at, label)
                before.append(self.table(entry, at, to, label, known))

    def joined(
        self,
        there: Any,
        own: Mapping[str, Any],
        to: KeyPath,
        at: KeyPath,
        label: str,
        *,
        again: bool,
    ) -> dict[str, Any]:
        """Add a copy to what is there: of this name in the file, or, `again`, of another copy.

        What the file says of a copy counts; what two copies say must be in different places.
        """
        for name, value in own.items():
            here, source = (*to, name), (*at, name)
            before = there.get(name)
            if name not in there:
                there[name] = value
                self.made.setdefault(here, Copied(source, label))
            elif isinstance(before, dict) and isinstance(value, dict):
                self.joined(before, value, here, source, label, again=again)
            elif isinstance(before, list) and any(isinstance(one, dict) for one in before):
                for k, one in enumerate(value):
                    self.made[(*here, len(before))] = Copied((*source, k), label)
                    before.append(one)
            elif again:
                hint = "name each copy by a placeholder, as in [for.components.{each}]"
                raise self.wrong(f"two copies give {dotted(here)}", source, label, hint=hint)
        found: dict[str, Any] = there
        return found

    def table(
        self, value: Any, at: KeyPath, to: KeyPath, label: str, known: Mapping[str, Any]
    ) -> Any:
        """Return a value of a copy, at `to`; that with the placeholders is at `at`."""
        if isinstance(value, str):
            return self.filled(value, at, label, known)
        if isinstance(value, list):
            return [self.table(v, (*at, k), (*to, k), label, known) for k, v in enumerate(value)]
        if not isinstance(value, dict):
            return value
        found = {}
        for name, inner in value.items():
            made = str(self.filled(name, (*at, name), label, known))
            if made != name:
                self.made[(*to, made)] = Copied((*at, name), label)
            found[made] = self.table(inner, (*at, name), (*to, made), label, known)
        return found

    def filled(self, text: str, at: KeyPath, label: str, known: Mapping[str, Any]) -> Any:
        """Return a text with its placeholders replaced; the value itself where it is only one."""
        whole = _HOLES.fullmatch(text)
        if whole is not None and whole[1] is not None:
            return copy.deepcopy(self.value(whole[1], at, label, known))

        def fill(found: re.Match[str]) -> str:
            if found[1] is None:
                return found[0][0]
            value = self.value(found[1], at, label, known)
            if isinstance(value, dict | list):
                raise self.wrong(f"{{{found[1]}}} is not a word or a number", at, label)
            return str(value)

        return _HOLES.sub(fill, text)

    def value(self, text: str, at: KeyPath, label: str, known: Mapping[str, Any]) -> Any:
        """Return the value of a placeholder: of a name, or of an expression of numbers."""
        if (name := text.strip()) in known:
            return known[name]
        try:
            found = bind(Expression(text), _Known(known), "number")
            number = found.number(**{name: known[name] for name in found.names})
        except ExpressionError as error:
            raise self.wrong(
                error.what, at, label, expected=error.expected, got=error.got, hint=error.hint
            ) from error
        return int(number) if number == int(number) else number


@dataclass(frozen=True)
class _Known:
    """The names in braces: those of the copy that are numbers."""

    known: Mapping[str, Any]

    def meaning(self, reference: str) -> Meaning:
        """Return a number; an `InputError` if it is none."""
        if reference not in self.known:
            raise InputError.unknown("placeholder", reference, self.known)
        value = self.known[reference]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{reference} is not a number", got=repr(value)[:80])
        return Meaning("number", None)


def _placeholder(part: Mapping[str, Any]) -> Any:
    return part.get("as", "i" if "each" not in part else "each")


def _label(known: Mapping[str, Any]) -> str:
    own = [v for k, v in known.items() if k != "i" and isinstance(v, str | int | float)]
    return repr(own[0]) if own else str(known["i"])


def written_out(data: Mapping[str, Any], origin: Origin = NOWHERE) -> tuple[dict[str, Any], Origin]:
    """Return the tables of a scenario with all copies made, and what locates them.

    The same data, where nothing is there several times.

    Raises
    ------
    InputError : a loop or a placeholder that has no meaning; says the line and the copy.
    """
    found = {**data}
    parts = [found.get(table) for table in NAMED]
    if "for" not in found and not any(
        isinstance(part, dict) and ("count" in part or "each" in part)
        for entries in parts
        if isinstance(entries, dict)
        for part in entries.values()
    ):
        return found, origin
    copier = _Copier(origin, copy.deepcopy(found))
    for table in NAMED:
        copier.named(table)
    copier.every(copier.data.pop("for", []), ("for",), {})
    return copier.data, Origin(origin.layers, copier.made)
