"""Read the arguments of commands: systems, gains, lists of numbers and names; write files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, Literal

from cosim import hinf, scenario
from cosim.core import InputError, not_written, write_whole

AUTO: Final = "auto"
"""The word for an order that is chosen by what it costs."""


def named_problem(name: str) -> tuple[hinf.problem.NamedSystem, Any]:
    """Return the system that a name stands for, and the gain if it names a scenario with a gain."""
    if name not in scenario.builtin_names():
        return hinf.system_by_name(name), None
    loaded = scenario.load(name)
    part = loaded.scenario.design
    if part is None:
        raise InputError("this scenario has no [design]", where=name)
    if part.file is not None:
        problem, found, _ = scenario.named_design(part, loaded.folder)
        return hinf.problem.NamedSystem(problem.system, problem.k1, problem.k2), found.K.tolist()
    problem = scenario.problem_of(part, loaded.folder)
    named = hinf.problem.NamedSystem(
        problem.system, problem.k1, problem.k2, design_constraints=problem.design_constraints
    )
    return named, part.gain


def order_of(text: str, *words: str) -> int | Literal["auto"] | None:
    """Return the order that --order names, one of these words or a number; None: Theorem 2.

    Raises
    ------
    InputError : neither.
    """
    if text in words:
        return AUTO if text == AUTO else None
    try:
        return int(text)
    except ValueError:
        raise InputError(
            "not an order",
            where="--order",
            expected=f"{', '.join(words)} or a whole number",
            got=repr(text),
        ) from None


def with_weights(
    named: hinf.problem.NamedSystem, weights: tuple[float, ...]
) -> hinf.problem.NamedSystem:
    """Replace the weights of z of a system; raise InputError if their number does not fit."""
    before = named.unweighted or named.system
    after = hinf.problem.weighted(before, weights, where="--weights")
    return replace(named, system=after, weights=weights, unweighted=before)


def gain_from(text: str) -> Any:
    """Return a matrix written as JSON rows; raise InputError for any other text."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            "not a matrix",
            where="--gain",
            expected='rows as in "[[0.6, -0.5]]"',
            got=text,
            hint="one row per control input, commas between the numbers; no file",
        ) from error
    if isinstance(value, list) and value and not isinstance(value[0], list):
        raise InputError(
            "not a matrix",
            where="--gain",
            expected='rows as in "[[0.6, -0.5]]"',
            got=text,
            hint=f'one row per control input: "[{text.strip()}]"',
        )
    return hinf.certificate.matrix_from_rows(value, "--gain")


def numbers(option: str, text: str) -> tuple[float, ...]:
    """Return the numbers in "1,2.5"; raise InputError, naming the option, for other text."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            "not a list of numbers", where=option, expected="numbers separated by commas", got=text
        ) from error


def names(option: str, text: str) -> tuple[str, ...]:
    """Return the names in "a, b"; raise InputError, naming the option, if one is empty."""
    found = tuple(part.strip() for part in text.split(","))
    if not all(found):
        raise InputError(
            "not a list of names", where=option, expected="names separated by commas", got=text
        )
    return found


def write(path: Path, text: str) -> None:
    """Write a text file and the folders it needs; raise InputError if that fails."""
    with not_written("the file", path):
        write_whole(path, text.encode())


def write_json(path: Path, data: Any) -> None:
    """Write a JSON file; raise InputError if that fails."""
    write(path, json.dumps(data, indent=1, allow_nan=False) + "\n")


def number_or_text(text: str) -> float | str:
    """Return a number of the command line; another text, as one with a unit, as it is."""
    try:
        return float(text)
    except ValueError:
        return text
