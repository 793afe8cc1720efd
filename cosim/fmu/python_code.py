"""A component written in Python, flown as a node of the graph.

Its FMU is a shell of C (c/python_code.c) that calls the code by its address in this process, or in
a child that was forked from it. The master, links, events, snapshots and supervision see an FMU
like any other.
"""

from __future__ import annotations

import copy
import ctypes
import itertools
import math
import pickle
import re
import secrets
import struct
import traceback
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError

Reals = NDArray[np.float64]
Values = Mapping[str, Any]

_Doubles = ctypes.POINTER(ctypes.c_double)
_Text = ctypes.POINTER(ctypes.c_char)
_START = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_double, _Doubles, _Doubles, _Text)
_STEP = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, ctypes.c_double, ctypes.c_double, _Text)
_SIZE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, _Text)
_SAVE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, _Doubles, _Text)
_RESTORE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64, _Doubles, ctypes.c_int64, _Text)
_END = ctypes.CFUNCTYPE(None, ctypes.c_int64)
_NAME = re.compile(r"(?!code\.)[A-Za-z]\w*(\.[A-Za-z]\w*)*", re.ASCII)
"""Of a signal; `code.` is of the shell."""
_LONGEST = 500
"""Bytes of a reason; as of `Message` in C, with room."""


class Component:
    """A component in Python: its inputs and outputs, how it starts, and what a step does.

        >>> from cosim import Component, Scenario, run
        >>> class Tank(Component):
        ...     inputs, outputs = {"q": 1}, {"h": 1}
        ...     def start(self, t):
        ...         self.h = 1.0
        ...         return {"h": self.h}
        ...     def step(self, t, dt, u):
        ...         self.h += dt * (u["q"][0] - 0.1 * self.h)
        ...         return {"h": self.h}
        >>> result = run(Scenario(step=0.1, until=5).add("tank", Tank()), supervise=False)
        >>> bool(0.5 < result["tank.h"].values[-1] < 0.7)
        True

    In a scenario its variables are `tank.q` and `tank.h`; a variable of several values is
    `tank.x[1]`, ... Each run has a copy of the object. The attributes of the copy are its state
    between steps; a snapshot pickles them.

    Attributes
    ----------
    inputs, outputs : the number of values by name.
    """

    inputs: ClassVar[Mapping[str, int]] = {}
    outputs: ClassVar[Mapping[str, int]] = {}

    def start(self, t: float) -> Values | None:
        """Begin at a time [s]; return the outputs there, or None for zeros."""

    def step(self, t: float, dt: float, u: Mapping[str, Reals]) -> Values:
        """Go from t to t + dt [s] with inputs held; return the outputs at the end.

        u : by name arrays of doubles, which hold during the call.
        """
        raise NotImplementedError(f"{type(self).__name__} has no step")


class _Code(ctypes.Structure):
    _fields_: ClassVar = [
        ("mark", ctypes.c_double),
        ("start", _START),
        ("step", _STEP),
        ("size", _SIZE),
        ("save", _SAVE),
        ("restore", _RESTORE),
        ("end", _END),
    ]


class _Flying:
    """An instance of a component that flies: the copy, and its values in the memory of C."""

    def __init__(self, of: Component, u: Any, y: Any) -> None:
        self.of = copy.deepcopy(of)
        self.unsaved = ""  # why its attributes could not be saved
        self.inputs = _views(of.inputs, u)
        self.outputs = _views(of.outputs, y)

    def check_saved(self, count: int) -> None:
        """Refuse a state without numbers: its attributes could not be pickled."""
        if count == 0:
            raise InputError("its attributes could not be saved", got=self.unsaved)

    def publish(self, values: Values) -> None:
        if not isinstance(values, Mapping):
            got = type(values).__name__
            raise TypeError(f"outputs by name are expected, as in {{'y': 1.0}}, not {got}")
        for name, value in values.items():
            if name not in self.outputs:
                known = ", ".join(self.outputs) or "none"
                raise KeyError(f"there is no output {name!r}; the outputs are {known}")
            self.outputs[name][:] = value


class PythonCode:
    """A component in Python that C can call, as long as this object lives.

    component : what each instance is a copy of.
    """

    def __init__(self, component: Component) -> None:
        _check(component)
        self.component = component
        self._instances: dict[int, _Flying] = {}
        self._numbers = itertools.count()
        self._code = _Code(
            float(secrets.randbits(52) + 1),
            _START(self._start),
            _STEP(self._step),
            _SIZE(self._size),
            _SAVE(self._save),
            _RESTORE(self._restore),
            _END(self._end),
        )

    @property
    def parameters(self) -> dict[str, float]:
        """The start values by which its FMU finds it."""
        return {"code.address": float(ctypes.addressof(self._code)), "code.mark": self._code.mark}

    def _start(self, t: float, u: Any, y: Any, why: Any) -> int:
        try:
            flying = _Flying(self.component, u, y)
            for view in flying.outputs.values():
                view[:] = 0.0
            first = flying.of.start(t)
            flying.publish({} if first is None else first)
        except BaseException as error:  # noqa: BLE001 - C cannot pass it on
            return _refused(error, why, "start")
        number = next(self._numbers)
        self._instances[number] = flying
        return number

    def _step(self, number: int, t: float, dt: float, why: Any) -> int:
        try:
            flying = self._instances[number]
            flying.publish(flying.of.step(t, dt, flying.inputs))
        except BaseException as error:  # noqa: BLE001
            return _refused(error, why, "step")
        return 0

    def _size(self, number: int, why: Any) -> int:
        flying = self._instances[number]
        try:
            return 1 + math.ceil(len(self._saved(number)) / 4)
        except BaseException as error:  # noqa: BLE001
            flying.unsaved = f"{type(error).__name__}: {error}"
            return _refused(error, why, "a snapshot of its attributes")

    def _save(self, number: int, to: Any, why: Any) -> int:
        try:
            content = self._saved(number)
            words = struct.unpack(f"<{-(-len(content) // 4)}I", content + bytes(-len(content) % 4))
            to[0] = float(len(content))
            for i, word in enumerate(words, 1):
                to[i] = float(word)
        except BaseException as error:  # noqa: BLE001
            return _refused(error, why, "a snapshot of its attributes")
        return 0

    def _restore(self, number: int, values: Any, count: int, why: Any) -> int:
        try:
            self._instances[number].check_saved(count)
            words = [int(values[i]) for i in range(1, count)]
            content = struct.pack(f"<{len(words)}I", *words)[: int(values[0])]
            attributes = pickle.loads(content)  # noqa: S301 - what was saved here
            vars(self._instances[number].of).clear()
            vars(self._instances[number].of).update(attributes)
        except BaseException as error:  # noqa: BLE001
            return _refused(error, why, "restoring its attributes")
        return 0

    def _end(self, number: int) -> None:
        self._instances.pop(number, None)

    def _saved(self, number: int) -> bytes:
        return pickle.dumps(vars(self._instances[number].of))


_KEPT: dict[int, PythonCode] = {}
"""By the identity of its component: C may call it as long as the process lives."""


def code_of(component: Component) -> PythonCode:
    """Return a component as code that C can call, the same for the same object.

    Raises
    ------
    InputError : signals without a number of values, or no outputs.
    """
    if id(component) not in _KEPT:
        _KEPT[id(component)] = PythonCode(component)
    return _KEPT[id(component)]


def _views(signals: Mapping[str, int], values: Any) -> dict[str, Reals]:
    """Return a view by name of values in the memory of C."""
    total = sum(signals.values())
    whole = np.ctypeslib.as_array(values, (total,)) if total else np.zeros(0)
    views, at = {}, 0
    for name, count in signals.items():
        views[name] = whole[at : at + count]
        at += count
    return views


def _refused(error: BaseException, why: Any, what: str) -> int:
    """Write the reason where C says it, with the line of the code; return -1."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({frames[-1].filename}, line {frames[-1].lineno})" if len(frames) > 1 else ""
    text = f"{what} raises {type(error).__name__}: {error}{place}".encode("utf-8", "replace")[
        :_LONGEST
    ]
    ctypes.memmove(why, text + b"\0", len(text) + 1)
    return -1


def _check(component: Component) -> None:
    """Refuse what is no component: signals without a number, or none at all."""
    name = type(component).__name__
    for kind in ("inputs", "outputs"):
        signals = getattr(component, kind)
        fits = isinstance(signals, Mapping) and all(
            isinstance(count, int) and count >= 1 for count in signals.values()
        )
        if not fits:
            raise InputError(
                f"the {kind} of a component have no numbers",
                where=name,
                expected='the number of values by name, as in {"q": 1, "x": 3}',
                got=repr(signals),
            )
    if not component.outputs:
        raise InputError("a component without outputs", where=name, expected="outputs")
    names = [*component.inputs, *component.outputs]
    wrong = [one for one in names if not _NAME.fullmatch(one) or names.count(one) > 1]
    if wrong:
        raise InputError(
            "these are no names of inputs and outputs",
            where=name,
            expected="ASCII letters, digits, _ and dots, a letter first; each once",
            got=", ".join(dict.fromkeys(wrong)),
        )
