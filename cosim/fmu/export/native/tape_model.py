"""Write a component as data, resources/model.bin, for a binary that reads its model; c/tape.c.

The tape of its equations becomes a list of operations in the recorded order, so that they give the
bits of the C that is made from the same tape. The file has words of 64 bits, little endian.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping, Sequence

from cosim.core import InputError
from cosim.fmu.export.native.c_model import ModelWriter, enumerator
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
_MOST_VARIABLES, _MOST_CONSTANTS, _MOST_SLOTS, _MOST_LANES = 4096, 1024, 2048, 64
"""As in c/tape.h."""
_LISTED = re.compile(r"(u|y|initial|bias|noise|loss\.state|loss\.move)\[[\d,]+\]")


def model_data(writer: ModelWriter, identity: str) -> bytes:
    """Return the content of resources/model.bin.

    Raises
    ------
    InputError : a component that is too large for a binary that reads its model.
    """
    spec = writer.spec
    place = {enumerator(v.name): i for i, v in enumerate(spec.variables)}
    texts = "\n".join(spec.constants.get("texts", ()))
    named = spec.constants.get("link", spec.constants.get("sensor", texts))
    words = [b"AUVMODEL", _integers(1), _text(identity), _text(str(named))]
    _refuse_beyond(_MOST_VARIABLES, len(spec.variables), "variables", spec.name)
    words.append(_integers(len(spec.variables)))
    for v in spec.variables:
        causality = ("input", "output", "parameter").index(v.causality)
        kind = ("Real", "Integer").index(v.kind)
        low = float("-inf") if v.minimum is None else v.minimum
        high = float("inf") if v.maximum is None else v.maximum
        words += [_text(v.name), _integers(causality, kind), _doubles([v.start, low, high])]
    defined = writer.defined
    references = [place.get(str(defined.get(n)), 0) for n in ("MODEL_STEP", "MODEL_SAMPLE_TIME")]
    numbers = [defined.get(n, 0) for n in ("LATE_BEGIN", "LATE_END", "MODEL_CONSTANTS")]
    instants, rows = writer.rows
    words.append(_integers(*references, *(int(str(n)) for n in numbers), len(instants)))
    tables = {**writer.tables, "named": [*named_variables(writer)]}
    for name in _TABLES:
        listed = [place[enumerator(variable)] for variable in tables.get(name, ())]
        most = _MOST_LANES if "MODEL_LANES" in defined else _MOST_TABLE[name]
        _refuse_beyond(most, len(listed), name.removeprefix("model_"), spec.name)
        words.append(_integers(len(listed), *listed))
    pool: dict[str, int] = {}
    programs = b"".join(_programs(writer, place, pool))
    words += [_integers(len(pool)), _doubles(map(float, pool)), programs]
    words += [_text(text) for _, text in writer.conditions]
    words += [_integers(*instants), _doubles(value for row in rows for value in row)]
    return b"".join(words)


def named_variables(writer: ModelWriter) -> Iterable[str]:
    """Yield the variables that the C of a link or sensor names: all but those of tables."""
    if "named" in writer.spec.constants:
        yield from writer.spec.constants["named"]
    elif "MODEL_LANES" in writer.defined:
        yield from (v.name for v in writer.spec.variables if not _LISTED.fullmatch(v.name))


def model_header(writer: ModelWriter) -> str:
    """Return model.h for the binary; it is the same for every component of a kind."""
    named = "".join(
        f"#define {enumerator(name)} (model.reference[TO_NAMED][{i}])\n"
        for i, name in enumerate(named_variables(writer))
    )
    orders = "".join(
        f"#define {name} {value}\n"
        for name, value in writer.defined.items()
        if name.startswith("ORDER_")
    )
    return (
        "/* The model is read from the resources when the first instance is made. */\n\n"
        f'#ifndef MODEL_H\n#define MODEL_H\n\n#include "tape.h"\n\n{named}{orders}\n#endif\n'
    )


def _programs(
    writer: ModelWriter, place: Mapping[str, int], pool: dict[str, int]
) -> Iterable[bytes]:
    """Yield the words of each program; numbers of the equations are added to `pool`."""
    programs = {**writer.programs}
    programs["model_objection"] = [("", value) for value, _ in writer.conditions]
    hoisted = {scalar.place: i for i, (_, scalar) in enumerate(programs.get("model_constants", ()))}
    _refuse_beyond(_MOST_CONSTANTS, len(hoisted), "constants of a run", writer.spec.name)
    for name in _PROGRAMS:
        known = {} if name in ("model_constants", "model_objection") else hoisted
        roots = [scalar for _, scalar in programs.get(name, ())]
        yield _program(writer, roots, known, place, pool)


def _program(
    writer: ModelWriter,
    roots: Sequence[Scalar],
    known: Mapping[int, int],
    place: Mapping[str, int],
    pool: dict[str, int],
) -> bytes:
    """Return the words of a program that computes `roots`; values share slots where they can."""
    recorded = writer.tape.operations
    here = dict.fromkeys(known, "c")
    needed = required_places(writer.tape, [root.place for root in roots], here)
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
    _refuse_beyond(_MOST_SLOTS, slots, "values at a time", writer.spec.name)
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
            hint="compile it: --platforms host, or all",
        )
