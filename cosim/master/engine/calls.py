"""Calls through addresses in compiled code: intrinsics that turn an integer into a pointer.

No address becomes part of the compiled code, so that it is compiled once and cached on disk.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_INT8, _INT32, _INT64, _DOUBLE = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()


@intrinsic  # type: ignore[untyped-decorator]
def exchange_2(
    _typing: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """Call fmi2Get... or fmi2Set... at an address."""
    del function, component, references, count, values
    signature = types.int32(*[types.int64] * 5)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64] * 4)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def exchange_3(
    _typing: Any, function: Any, component: Any, references: Any, count: Any, values: Any, size: Any
) -> Any:
    """Call fmi3Get... or fmi3Set... at an address."""
    del function, component, references, count, values, size
    signature = types.int32(*[types.int64] * 6)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64] * 5)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def step_2(_typing: Any, function: Any, component: Any, now: Any, size: Any, final: Any) -> Any:
    """Call fmi2DoStep at an address; `final`: noSetFMUStatePriorToCurrentPoint."""
    del function, component, now, size, final
    signature = types.int32(types.int64, types.int64, types.float64, types.float64, types.int32)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64, _DOUBLE, _DOUBLE, _INT32])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(function, arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def step_3(
    _typing: Any, function: Any, component: Any, now: Any, size: Any, final: Any, results: Any
) -> Any:
    """Call fmi3DoStep at an address; it writes to `results` three C bools, and a double at 8."""
    del function, component, now, size, final, results
    signature = types.int32(
        types.int64, types.int64, types.float64, types.float64, types.int32, types.int64
    )

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        # a C bool is passed as an int whose other bits are zero
        kind = ir.FunctionType(_INT32, [_INT64, _DOUBLE, _DOUBLE, _INT32, *[_INT64] * 4])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        places = [builder.add(arguments[5], ir.Constant(_INT64, i)) for i in (0, 1, 2, 8)]
        return builder.call(function, [*arguments[1:5], *places])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def load(_typing: Any, address: Any) -> Any:
    """Read the integer at an address."""
    del address
    signature = types.int64(types.int64)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], _INT64.as_pointer()))

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def byte(_typing: Any, address: Any) -> Any:
    """Read the byte at an address."""
    del address
    signature = types.int64(types.int64)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        found = builder.load(builder.inttoptr(arguments[0], _INT8.as_pointer()))
        return builder.zext(found, _INT64)

    return signature, generate
