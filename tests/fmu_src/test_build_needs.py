"""A wheel is built where nothing is installed but what its build asks for."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULES = {"markdown-it-py": "markdown_it"}

ALONE = """\
import importlib.abc, sys
from importlib.machinery import PathFinder
from pathlib import Path

allowed, site = set(sys.argv[1].split(",")), Path(sys.argv[2])

class Refuse(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if path is None and name not in allowed:
            found = PathFinder.find_spec(name)
            if found is not None and site in Path(found.origin or "/").parents:
                raise ModuleNotFoundError(f"{name} is not there")

sys.meta_path.insert(0, Refuse())
import build_fmu

sys.argv = ["build_fmu.py", "PaperController", "--flavour", "native", "--out", sys.argv[3]]
assert build_fmu.main() == 0
print("built")
"""


def requirements() -> list[str]:
    """What hatch_build.py asks for."""
    tree = ast.parse((ROOT / "hatch_build.py").read_text("utf-8"))
    (value,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "REQUIREMENTS"
    )
    return [re.split(r"[<>=]", text)[0] for text in ast.literal_eval(value)]


def with_their_own(names: list[str]) -> set[str]:
    """The modules of these distributions, and of what they ask for."""
    modules, left = set(), list(names)
    while left:
        name = left.pop()
        module = MODULES.get(name, name.replace("-", "_"))
        if module not in modules:
            modules.add(module)
            asked = [x for x in requires(name) or [] if "extra ==" not in x]
            left += [re.split(r"[<>=~!;\s\[(]", x)[0] for x in asked]
    return modules


def test_what_builds_the_wheel_needs_nothing_else(tmp_path: Path) -> None:
    """build_fmu.py is imported, and builds an FMU, with all other packages refused."""
    allowed = {*with_their_own(requirements()), "build_fmu", "cosim"}
    site = next(p for p in sys.path if p.endswith("site-packages"))
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-c", ALONE, ",".join(sorted(allowed)), site, str(tmp_path)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split()[-1:] == ["built"], done.stderr[-2000:]
    assert [path.name for path in tmp_path.rglob("*.fmu")] == ["PaperController.fmu"]
