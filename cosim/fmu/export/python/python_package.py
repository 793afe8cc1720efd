"""Build the pythonfmu FMU of a component: its modules, the slave, the archive.

All FMUs of a process share one table of imported modules, so an FMU imports everything from a
package whose name contains the FMU's hash.
"""

from __future__ import annotations

import ast
import contextlib
import importlib
import importlib.metadata
import importlib.util
import io
import json
import pprint
import re
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from cosim.fmu.export.documentation import documentation_files
from cosim.fmu.export.model_description import fmi2_xml
from cosim.fmu.export.spec import SLAVE, ComponentSpec
from cosim.fmu.export.terminal_file import terminal_files
from cosim.fmu.export.zip_file import deterministic_zip
from cosim.fmu.unpacking import own_folder

_IMPORT = re.compile(
    r"^from (?P<package>cosim[\w.]*) import (?P<names>\([^)]*\)|[^\n(]+)$", flags=re.MULTILINE
)


def component_sources(spec: ComponentSpec) -> dict[str, bytes]:
    """Return by module name the source text of everything that runs inside the FMU."""
    sources = {}
    slaves = dict.fromkeys(slave.split(":")[0] for slave in (SLAVE, spec.slave))
    for module in (*spec.sources, *slaves):
        found = importlib.util.find_spec(module)
        if found is None or found.origin is None:
            raise ModuleNotFoundError(f"{spec.name} names the module {module}, which is not there")
        sources[module] = Path(found.origin).read_bytes().replace(b"\r\n", b"\n")
    return sources


def guid(spec: ComponentSpec) -> str:
    """Return the hash that shows whether a built FMU is up to date.

    It covers the whole archive: sources, resources, PythonFMU's version, the script, the model
    description and the documentation.
    """
    sources = component_sources(spec)
    unnamed = {module: _flat(module) for module in sources}
    return spec.guid(
        {
            **sources,
            "pythonfmu": importlib.metadata.version("pythonfmu").encode(),
            "script": _script(spec, "", unnamed).encode(),
            "modelDescription.xml": _description(spec, ""),
            **documentation_files(spec),
            **terminal_files(spec),
            **spec.resource_files(),
        }
    )


def build_python_fmu(spec: ComponentSpec, destination: Path) -> Path:
    """Write `destination`/NAME.fmu and return its path; two builds give the same bytes."""
    sources = component_sources(spec)
    identity = guid(spec)
    tag = re.sub(r"[^0-9a-f]", "", identity)[:12]
    package = f"{spec.name}_{tag}_parts"
    renamed = {module: f"{package}.{_flat(module)}" for module in sources}
    with tempfile.TemporaryDirectory(prefix="fmu-", dir=own_folder()) as folder:
        parts = Path(folder, package)
        parts.mkdir()
        (parts / "__init__.py").write_text(f'"""Modules of {spec.name}."""\n')
        homes = _homes(sources)
        for module, text in sources.items():
            moved = _renamed_imports(text.decode(), renamed, homes)
            (parts / f"{_flat(module)}.py").write_text(moved, newline="\n")
        (parts / "table.py").write_text(_table_module(spec), newline="\n")
        script = Path(folder, f"{spec.name}_{tag}.py")
        script.write_text(_script(spec, package, renamed), newline="\n")
        raw = Path(folder, "raw")
        with (
            _installed_builder(f"{spec.name}_{tag}") as builder,
            contextlib.redirect_stdout(io.StringIO()),
        ):
            built = builder.build_FMU(script, dest=raw, project_files={parts})
        with zipfile.ZipFile(built) as archive:
            files = {
                name: archive.read(name)
                for name in archive.namelist()
                if not name.endswith("/") and "__pycache__" not in name
            }
    files["modelDescription.xml"] = _description(spec, identity)
    files.update(documentation_files(spec))
    files.update(terminal_files(spec))
    files.update(spec.resource_files())
    return deterministic_zip(files, destination / f"{spec.name}.fmu")


@contextlib.contextmanager
def _installed_builder(fmu: str) -> Iterator[Any]:
    """Give the builder of the PythonFMU that is installed; leave path and modules as they are.

    An FMU that this process has flown may contain a PythonFMU, without binaries, and leave it
    imported and its folder first on the path; and be the one that is built, `fmu`.
    """
    home = str(importlib.metadata.distribution("pythonfmu").locate_file(""))
    loaded = sys.modules.get("pythonfmu")
    installed = loaded is None or (loaded.__file__ or "").startswith(home)

    def concerned() -> list[str]:
        of_fmu = [m for m in sys.modules if m.startswith(fmu)]
        of_pythonfmu = [m for m in sys.modules if m.partition(".")[0] == "pythonfmu"]
        return of_fmu if installed else of_fmu + of_pythonfmu

    path = list(sys.path)
    before = {module: sys.modules.pop(module) for module in concerned()}
    sys.path.insert(0, home)
    try:
        yield importlib.import_module("pythonfmu.builder").FmuBuilder
    finally:
        sys.path[:] = path
        for module in concerned():
            del sys.modules[module]
        sys.modules.update(before)


def _description(spec: ComponentSpec, identity: str) -> bytes:
    tool = f"auv-cosim with PythonFMU {importlib.metadata.version('pythonfmu')}"
    return fmi2_xml(spec, identity, tool=tool, needs_tool=True)


def _flat(module: str) -> str:
    return module.replace(".", "_")


def _renamed_imports(text: str, renamed: dict[str, str], home: Mapping[str, str]) -> str:
    """Redirect the imports of a module to those packed beside it; `home`: name -> its module."""

    def moved(found: re.Match[str]) -> str:
        modules: dict[str, list[str]] = {}
        for name in re.findall(r"\w+", re.sub("#.*", "", found["names"])):
            module = found["package"] if found["package"] in renamed else home.get(name, "")
            modules.setdefault(renamed.get(module, found["package"]), []).append(name)
        return "\n".join(f"from {m} import {', '.join(names)}" for m, names in modules.items())

    text = _IMPORT.sub(moved, text)
    left = re.search(r"^\s*(?:from|import) (?:cosim|numpy)\b.*", text, flags=re.MULTILINE)
    # indented imports are in functions for design, which the FMU never calls
    if left is not None and not left.group().startswith(" "):
        raise ValueError(f"a module of the FMU imports what is not in it: {left.group().strip()}")
    return text


def _homes(sources: Mapping[str, bytes]) -> dict[str, str]:
    """Return by name the module of the sources that defines it, for imports from a package."""
    homes = {}
    for module, text in sources.items():
        for node in ast.parse(text).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                homes[node.name] = module
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                homes.update({t.id: module for t in targets if isinstance(t, ast.Name)})
    return homes


def _table_module(spec: ComponentSpec) -> str:
    table = pprint.pformat(tuple(spec.table()), width=100, sort_dicts=False)
    constants = pprint.pformat(json.loads(json.dumps(dict(spec.constants))), width=100)
    return (
        f'"""Variables and constants of {spec.name}; value reference = position from 1."""\n\n'
        f"TABLE = {table}\n\nCONSTANTS = {constants}\n"
    )


def _script(spec: ComponentSpec, package: str, renamed: dict[str, str]) -> str:
    module, cls = spec.behaviour.split(":")
    slave_module, slave = spec.slave.split(":")
    behaviour = f"Behaviour{cls}"
    return (
        f'"""{spec.name}: {spec.description}.\n\n'
        f'Edit the parts in {package}; this module only joins them.\n"""\n\n'
        "import ctypes\n\n"
        f"from {renamed[module]} import {cls} as {behaviour}\n"
        f"from {renamed[slave_module]} import {slave}\n"
        f"from {package}.table import CONSTANTS as _CONSTANTS\n"
        f"from {package}.table import TABLE as _TABLE\n\n"
        "# PythonFMU's loader runs this text for every instance and releases a reference to the\n"
        "# module's dictionary that it never took: without one more, the second instance of a\n"
        "# process would use a freed dictionary.\n"
        "ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))\n\n\n"
        f"class {spec.name}({slave}):\n"
        f'    """{spec.description}."""\n\n'
        f"    TABLE = _TABLE\n"
        f"    CONSTANTS = _CONSTANTS\n"
        f"    BEHAVIOUR = {behaviour}\n\n\n"
        "# The loader never releases the class that it finds here: all instances share one class,\n"
        "# or each further instance would leak one.\n"
        f'{spec.name} = globals().setdefault("_first", {spec.name})\n'
    )
