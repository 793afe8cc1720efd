"""Write a component as data, resources/model.bin, for a binary that reads its model; c/tape.c.

The tape of its equations becomes a list of operations in the recorded order, so that they give the
bits of the C that is made from the same tape. The file has words of 64 bits, little endian.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence

from cosim.core import InputError
from cosim.fmu.export.native.model import NativeModel, enumerator
from cosim.tape import OPERATIONS, Scalar, required_places

_ARRAYS = {"slots": 0, "v": 1, "c": 2, "x": 3, "late": 4, "change": 5, "t": 6, "elapsed": 6}
_POOL = 7
_PROGRAMS = (
    *("model_constants", "model_rates", "model_other_outputs", "model_outputs_change"),
    *("model_objection", "model_law", "model_compared", "model_decided"),
)
_TABLES = (
    *("model_inputs", "model_outputs", "model_states", "model_initials", "model_delays"),
    *("model_others", "named", "model_measured", "model_acting", "model_watched", "model_play"),
)
_MOST_TABLE = dict.fromkeys(_TABLES, 128) | {"model_states": 64, "model_delays": 8}
_MOST_VARIABLES, _MOST_CONSTANTS, _MOST_SLOTS = 4096, 1024, 2048
"""As in c/tape.h."""
_NUMBERS = ("LATE_BEGIN", "LATE_END")


def model_data(model: NativeModel, named: Sequence[str], identity: str) -> bytes:
    """Return the content of resources/model.bin.

    named : the value references, as C has them, that the C of the kind names.
    identity : what the binary checks.

    Raises
    ------
    InputError : a component that is too large for a binary that reads its model.
    """
    spec = model.spec
    place = {enumerator(v.name): i for i, v in enumerate(spec.variables)}
    words = [b"AUVMODEL", _integers(2), _text(identity), _text(model.text)]
    _refuse_beyond(_MOST_VARIABLES, len(spec.variables), "variables", spec.name)
    words.append(_integers(len(spec.variables)))
    for v in spec.variables:
        causality = ("input", "output", "parameter").index(v.causality)
        kind = ("Real", "Integer").index(v.kind)
        low = float("-inf") if v.minimum is None else v.minimum
        high = float("inf") if v.maximum is None else v.maximum
        words += [_text(v.name), _integers(causality, kind), _doubles([v.start, low, high])]
    instants, rows = model.rows
    numbers = [int(model.numbers.get(name, 0)) for name in _NUMBERS]
    words.append(_integers(*numbers, len(model.known), len(instants)))
    absent = dict.fromkeys(map(enumerator, model.absent), 0)
    tables = {name: [*map(enumerator, listed)] for name, listed in model.tables.items()}
    for name in _TABLES:
        listed = [*named] if name == "named" else tables.get(name, [])
        _refuse_beyond(_MOST_TABLE[name], len(listed), name.removeprefix("model_"), spec.name)
        words.append(_integers(len(listed), *((place | absent)[one] for one in listed)))
    pool: dict[str, int] = {}
    programs = b"".join(_programs(model, place, pool))
    words += [_integers(len(pool)), _doubles(map(float, pool)), programs]
    words += [_text(text) for _, text in model.conditions]
    words += [_integers(*instants), _doubles(value for row in rows for value in row)]
    return b"".join(words)


def data_header(named: Sequence[str]) -> str:
    """Return model.h for the binary of a kind, the same for every component of it."""
    listed = "".join(
        f"#define {name} (model.reference[TO_NAMED][{i}])\n" for i, name in enumerate(named)
    )
    return (
        "/* The model is read from the resources when the first instance is made. */\n\n"
        f'#ifndef MODEL_H\n#define MODEL_H\n\n#include "tape.h"\n\n{listed}\n#endif\n'
    )


def _programs(
    model: NativeModel, place: Mapping[str, int], pool: dict[str, int]
) -> Iterator[bytes]:
    """Yield the words of each program; numbers of the equations are added to `pool`."""
    results = {
        name: [scalar for _, scalar in program.targets] for name, program in model.programs.items()
    }
    results["model_objection"] = [value for value, _ in model.conditions]
    _refuse_beyond(_MOST_CONSTANTS, len(model.known), "constants of a run", model.spec.name)
    for name in _PROGRAMS:
        known = {} if name in ("model_constants", "model_objection") else model.known
        yield _program(model, results.get(name, []), known, place, pool)


def _program(
    model: NativeModel,
    roots: Sequence[Scalar],
    known: Mapping[int, int],
    place: Mapping[str, int],
    pool: dict[str, int],
) -> bytes:
    """Return the words of a program that computes `roots`; values share slots where they can."""
    recorded = model.tape.operations
    needed = required_places(model.tape, [root.place for root in roots], known)
    last = {p: i for i, at in enumerate(needed) if at not in known for p in recorded[at].operands}
    last |= {root.place: len(needed) for root in roots}
    operand: dict[int, int] = {}
    free: list[int] = []
    slots, operations = 0, []
    for i, at in enumerate(needed):
        one = recorded[at]
        if at in known:
            operand[at] = _at("c", known[at])
        elif one.name == "symbol":
            operand[at] = _symbol(one.text, place)
        elif one.name == "constant":
            operand[at] = _POOL << 32 | pool.setdefault(one.text, len(pool))
        else:
            a, b = operand[one.operands[0]], operand[one.operands[-1]]
            free += [operand[p] for p in {*one.operands} if last[p] == i and operand[p] < 1 << 32]
            slot = free.pop() if free else slots
            slots = max(slots, slot + 1)
            operand[at] = slot
            operations.append((OPERATIONS.index(one.name), a, b, slot))
    _refuse_beyond(_MOST_SLOTS, slots, "values at a time", model.spec.name)
    results = [operand[root.place] for root in roots]
    flat = [word for operation in operations for word in operation]
    return _integers(len(operations), *flat, len(results), *results)


def _at(array: str, index: int) -> int:
    return _ARRAYS[array] << 32 | index


def _symbol(text: str, place: Mapping[str, int]) -> int:
    found = re.fullmatch(r"(\w+)(?:\[(\w+)\])?", text)
    if found is None:
        raise ValueError(f"no symbol of a model: {text}")
    array, index = found.groups()
    return _at(array, place[index] if array == "v" else int(index or 0))


def _integers(*values: int) -> bytes:
    return struct.pack(f"<{len(values)}q", *values)


def _doubles(values: Iterable[float]) -> bytes:
    listed = [float(value) for value in values]
    return struct.pack(f"<{len(listed)}d", *listed)


def _text(text: str) -> bytes:
    content = text.encode() + b"\0"
    content += bytes(-len(content) % 8)
    return _integers(len(content) // 8) + content


def _refuse_beyond(most: int, count: int, what: str, name: str) -> None:
    if count > most:
        raise InputError(
            "the component is too large for a prebuilt binary",
            where=name,
            expected=f"at most {most} {what}",
            got=str(count),
            hint="compile it: `platforms` host, or all",
        )
