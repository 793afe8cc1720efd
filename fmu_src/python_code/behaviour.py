"""Behaviour of Python code: its steps are elsewhere; c/python_code.c calls them."""

from __future__ import annotations

from typing import Any, NoReturn


class PythonCode:
    """Names of inputs and outputs; it has no steps of its own.

    Attributes
    ----------
    inputs, outputs : their names.
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.inputs: list[str] = constants["inputs"]
        self.outputs: list[str] = constants["outputs"]

    def initialise(self, _: dict[str, float], __: float) -> NoReturn:
        """Refuse: an FMU of pythonfmu has no such code.

        Raises
        ------
        ArithmeticError : in any case.
        """
        raise ArithmeticError("Python code flies in the process that has it, by a native FMU")
