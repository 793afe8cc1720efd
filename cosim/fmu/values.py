"""Check values of variables before an FMU gets them, and shape those that it gives."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from cosim.core import InputError
from cosim.fmu.port import Port

_GREATEST_FLOAT32 = float(np.finfo("f4").max)
_EXPECTED = {
    "float": "a number",
    "int": "an integer",
    "bool": "true or false",
    "string": "a text",
    "binary": "bytes, or their hexadecimal text",
}


def checked_scalars(port: Port, value: Any, where: str) -> list[Any]:
    """Return the scalars of a value in C's order, each of the port's type and in its range.

    The `value` of an array is nested sequences of its shape, or one flat sequence.

    Raises
    ------
    InputError : another type, another shape, out of range.
    """
    if port.kind is None or port.kind == "clock":
        raise InputError(
            f"{port.name} is of a type that cannot be exchanged here",
            where=where,
            expected="a number, a truth value, a text or bytes",
            got=port.getter_type,
        )
    return [_checked(port, item, where) for item in _flat(port, value, where)]


def _flat(port: Port, value: Any, where: str) -> list[Any]:
    if not port.shape:
        return [value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value]
    plain = value.tolist() if isinstance(value, np.ndarray) else value
    shape = _shape(plain)
    if shape not in (port.shape, (port.size,)):
        raise InputError(
            f"{port.name} is an array of another shape",
            where=where,
            expected=" x ".join(map(str, port.shape)),
            got=" x ".join(map(str, shape)) or "one value",
        )
    return list(_leaves(plain, len(shape)))


def _shape(value: Any) -> tuple[int, ...]:
    """Shape of nested sequences; ragged ones have a length of -1."""
    if isinstance(value, str | bytes) or not isinstance(value, Sequence):
        return ()
    inner = {_shape(item) for item in value}
    if len(inner) > 1:
        return (len(value), -1)
    return (len(value), *(inner.pop() if inner else ()))


def _leaves(value: Any, depth: int) -> Iterator[Any]:
    if depth == 0:
        yield value
        return
    for item in value:
        yield from _leaves(item, depth - 1)


def _checked(port: Port, value: Any, where: str) -> Any:
    item = value.item() if isinstance(value, np.generic) else value
    truth = isinstance(item, bool)
    number = isinstance(item, int | float)
    fits = {
        "float": number and not truth,
        "int": number and not truth and item == item // 1,
        "bool": truth or (number and item in (0, 1)),
        "string": isinstance(item, str) and "\0" not in item,
        "binary": isinstance(item, bytes) or _is_hexadecimal(item),
    }[str(port.kind)]
    if not fits:
        raise InputError(
            f"{port.name} is of another type",
            where=where,
            expected=_EXPECTED[str(port.kind)],
            got=repr(item),
        )
    if port.kind == "string":
        return item
    if port.kind == "binary":
        return item if isinstance(item, bytes) else bytes.fromhex(item)
    if port.kind == "bool":
        return bool(item)
    if port.kind == "int":
        item = int(item)
    _check_range(port, item, where)
    return item


def _is_hexadecimal(item: Any) -> bool:
    """Whether a value is a text of bytes, two hexadecimal digits each."""
    return isinstance(item, str) and re.fullmatch(r"([0-9A-Fa-f]{2})*", item) is not None


def _check_range(port: Port, value: float, where: str) -> None:
    """Refuse a value that the model description does not allow."""
    low, high = port.minimum, port.maximum
    if port.items and value not in port.items:
        expected = "one of " + ", ".join(map(str, port.items))
    elif (low is not None and value < low) or (high is not None and value > high):
        bounds = [f">= {low:g}"] if low is not None else []
        bounds += [f"<= {high:g}"] if high is not None else []
        expected = " and ".join(bounds)
    elif not _fits_c_type(port, value):
        expected = f"a value that {port.getter_type} holds"
    else:
        return
    raise InputError(f"{port.name} is out of range", where=where, expected=expected, got=f"{value}")


def _fits_c_type(port: Port, value: float) -> bool:
    """Whether the C type can hold a value; infinities and NaN fit every float."""
    if port.kind == "int":
        limits = np.iinfo(port.c_type)
        return bool(limits.min <= value <= limits.max)
    return port.c_type != "f4" or not math.isfinite(value) or abs(value) <= _GREATEST_FLOAT32


def rounded_to_c(port: Port, items: Sequence[Any]) -> list[Any]:
    """Return checked scalars as C holds them: floats of 32 bits are rounded, texts are bytes."""
    if port.c_type == "S":
        return [text.encode() for text in items]
    if port.c_type == "V":
        return list(items)
    return list(np.array(items, port.c_type).tolist())


def value_of(port: Port, items: Sequence[Any]) -> Any:
    """Return the value of a port from its scalars in C's order, as FMPy reads them."""
    plain: list[Any] = list(items)
    if port.kind == "bool":
        plain = [bool(item) for item in plain]
    elif port.kind == "string":
        plain = [(raw or b"").decode("utf-8", "replace") for raw in plain]
    elif port.kind == "binary":
        plain = [raw or b"" for raw in plain]
    return np.array(plain, dtype=object).reshape(port.shape).tolist()
