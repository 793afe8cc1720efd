"""Find the file of a design: one of the package by name, or a path."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from cosim.core import InputError, unreadable
from cosim.fmu.inspect import certificate_in_fmu


def design_content(name: str, folder: Path) -> tuple[str, bytes]:
    """Return the name of a design for messages, and the bytes of its file.

    `name` : a path that ends in .json or .fmu, relative to `folder`, or a design of the package.

    Raises
    ------
    InputError : no such design; an FMU that starts with another gain than it is certified for.
    """
    if name.endswith(".fmu"):
        path = folder / name
        inside = certificate_in_fmu(path)
        if inside.mismatch is not None:
            raise InputError(
                "the certificate in this FMU is not about its gain",
                where=str(path),
                got=inside.mismatch,
                hint="cosim fmu controller packs a design and its gain together",
            )
        return str(path), inside.content
    if name.endswith(".json"):
        path = folder / name
        try:
            return str(path), path.read_bytes()
        except OSError as error:
            raise unreadable(
                path,
                error,
                what="the design cannot be read",
                expected="a file that cosim design --save wrote",
            ) from error
    ours = files("cosim.scenario").joinpath("library", "designs")
    known = {p.name.removesuffix(".json"): p for p in ours.iterdir()}
    if name not in known:
        listed = [*known, "FILE.json", "FILE.fmu"]
        wrong = InputError.unknown("design", name, listed, where="design.file")
        if name.endswith(".toml"):
            wrong.hint = f'a system is named by another key: system = "{name}"'
        raise wrong
    return f"design {name}", known[name].read_bytes()
