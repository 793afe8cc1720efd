"""What the words on a command line stand for: problems, gains, numbers, files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

from cosim.core import InputError
from cosim.hinf import NamedSystem, matrix_from_rows, system_by_name, weighted
from cosim.scenario import builtin_names, load, named_design, problem_of


def named_problem(name: str) -> tuple[NamedSystem, Any]:
    """A scenario's design, or a system by its name; and the gain that the scenario gives."""
    if name not in builtin_names():
        return system_by_name(name), None
    loaded = load(name)
    part = loaded.scenario.design
    if part is None:
        raise InputError("this scenario has no design", where=name)
    if part.file is not None:
        problem, found, _ = named_design(part, loaded.folder)
        return NamedSystem(problem.system, problem.k1, problem.k2), found.K.tolist()
    problem = problem_of(part, loaded.folder)
    named = NamedSystem(
        problem.system, problem.k1, problem.k2, design_constraints=problem.design_constraints
    )
    return named, part.gain


def with_weights(named: NamedSystem, weights: tuple[float, ...]) -> NamedSystem:
    """The system with these weights of z, in place of its own.

    Raises
    ------
    InputError : they do not fit it.
    """
    before = named.unweighted or named.system
    after = weighted(before, weights, where="--weights")
    return replace(named, system=after, weights=weights, unweighted=before)


def gain_from(text: str) -> Any:
    """A matrix written as JSON.

    Raises
    ------
    InputError : it is none.
    """
    try:
        value = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(
            "not a matrix", where="--gain", expected='rows as in "[[0.6, -0.5]]"', got=text
        ) from error
    return matrix_from_rows(value, "--gain")


def numbers(option: str, text: str) -> tuple[float, ...]:
    """Numbers separated by commas.

    Raises
    ------
    InputError : they are none; the message names the option.
    """
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            "not a list of numbers", where=option, expected="numbers separated by commas", got=text
        ) from error


def names(option: str, text: str) -> tuple[str, ...]:
    """Names separated by commas.

    Raises
    ------
    InputError : one of them is empty.
    """
    found = tuple(part.strip() for part in text.split(","))
    if not all(found):
        raise InputError(
            "not a list of names", where=option, expected="names separated by commas", got=text
        )
    return found


def write(path: Path, text: str) -> None:
    """A text file, with the folders it needs.

    Raises
    ------
    InputError : it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, "utf-8")
    except OSError as error:
        raise InputError("the file cannot be written", where=str(path), got=str(error)) from error
