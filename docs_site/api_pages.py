"""The reference of the Python API: every name that the face of a package offers.

The faces are stubs (`__init__.pyi`) whose names are imported from other modules; a page refers to
a name where it is defined, and shows it once. What further faces offer links to it.
"""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import cosim
from docs_site.ring import RING

FACES = (
    *("cosim.hinf", "cosim.hinf.problem", "cosim.hinf.synthesis", "cosim.hinf.delay_lti"),
    "cosim.hinf.certificate",
    *("cosim.vehicle", "cosim.scenario", "cosim.trace", "cosim.study", "cosim.fmu"),
    *("cosim.fmu.export", "cosim.fmu.inspect", "cosim.fmu.compiled", "cosim.trace.outcome"),
    *("cosim.trace.rows", "cosim.trace.tables", "cosim.trace.comparison", "cosim.trace.exports"),
    *("cosim.trace.report", "cosim.trace.live", "cosim.trace.ros2", "cosim.trace.viewers"),
    *("cosim.network", "cosim.recordings", "cosim.master", "cosim.replay", "cosim.models"),
    *("cosim.tape", "cosim.core", "cosim.paper"),
)
"""Packages with a page, in the order in which a name that several offer is shown by the first."""

_ROOT = Path(cosim.__file__).parent


def pages() -> dict[str, str]:
    """Return the pages by their path: the front door, and one for each face."""
    found, shown = {}, dict[str, str]()
    for face in FACES:
        name = face.rpartition(".")[2]
        of_itself = "    options:\n      members: false\n      show_root_heading: false"
        sections = [f"# {face}", f"::: {face}\n{of_itself}"]
        for offered, place in names_of(face).items():
            if place in FACES:
                sections.append(f"## {offered}\n\nSee [{place}]({offered}.md).")
            elif place in shown:
                sections.append(f"## {offered}\n\nThe same as [{shown[place]}][{place}].")
            else:
                shown[place] = f"{face}.{offered}"
                sections.append(f"::: {place}\n    options:\n      heading_level: 2")
        found[f"reference/python/{name}.md"] = "\n\n".join(sections) + "\n"
    found["reference/python/index.md"] = _front_door()
    return found


def _front_door() -> str:
    rows = [
        f"| [`{offered}`][{place}] | {place.rpartition('.')[0]} |"
        for offered, place in names_of("cosim").items()
        if offered != "__version__"
    ]
    circle = [
        f"| {', '.join(f'[`{name}`][{defined(face, name)}]' for name in sorted(names))} | {face} |"
        for face, names in RING.items()
    ]
    faces = ", ".join(f"[{face}]({face.rpartition('.')[2]}.md)" for face in FACES)
    return "\n".join(
        [
            "# Python API",
            "",
            "`import cosim` offers these names; each loads what it needs when it is first used.",
            "",
            "| name | defined in |",
            "|---|---|",
            *rows,
            "",
            "## The second circle",
            "",
            "What programs use beside the front door; the text of each name has an example that a",
            "test runs.",
            "",
            "| names | import them from |",
            "|---|---|",
            *circle,
            "",
            "## Between packages",
            "",
            "What else a face offers is for the other packages of this project, and may change.",
            "",
            f"Every package has a face of its own: {faces}. Import from a face, never past it.",
            "",
        ]
    )


def names_of(face: str) -> dict[str, str]:
    """Return the names that a face offers, each with the place where it is defined."""
    return {name: defined(face, name) for name in _imported(face)}


def defined(module: str, name: str) -> str:
    """Return the dotted place of a name, followed through the faces that pass it on."""
    while (source := _imported(module).get(name)) is not None:
        module, name = source
        if not name:
            return module
    return f"{module}.{name}"


@cache
def _imported(module: str) -> dict[str, tuple[str, str]]:
    """Return what a face or a module imports from ours, each with module and name there.

    A name that is a module itself has an empty name.
    """
    path = _ROOT.joinpath(*module.split(".")[1:])
    sources = (path / "__init__.pyi", path / "__init__.py", path.with_suffix(".py"))
    source = next((one for one in sources if one.exists()), None)
    if source is None:
        return {}
    found = {}
    for node in ast.parse(source.read_text("utf-8")).body:
        if isinstance(node, ast.ImportFrom):
            base = f"{module}.{node.module}" if node.level and node.module else node.module
            for alias in node.names:
                place = (str(base), alias.name) if node.module else (f"{module}.{alias.name}", "")
                if place[0].startswith("cosim."):
                    found[alias.asname or alias.name] = place
    return found
