"""Parse XML of an FMU without entities and network, and validate it against the XSD."""

from __future__ import annotations

import threading
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from lxml import etree

from cosim.core import InputError
from cosim.fmu.inspect.findings import Finding, finding, printable

MAX_XML = 64 << 20  # 100,000 variables take about 30 MiB
"""Greatest size of a model description [bytes]."""


def parse_xml(content: bytes | None, name: str) -> tuple[Any, list[Finding]]:
    """Return the root element or None, and the findings.

    Parameters
    ----------
    content : None if it could not be read, because it is too large or damaged in the archive.
    name : path inside the FMU.
    """
    if content is None:
        return None, [finding("xml-large", name, f"more than {MAX_XML} bytes, or damaged")]
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False
    )
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        return None, [finding("xml-malformed", _line(name, error), str(error))]
    if root.getroottree().docinfo.doctype:
        return None, [finding("xml-doctype", name, "it has a document type declaration")]
    return root, []


def schema_findings(root: Any, schema: str, name: str) -> list[Finding]:
    """Return where `root` breaks a schema of the FMI project, a path in FMPy's folder of XSDs.

    Its encoding is looked at as well: the standards ask for UTF-8, and every reader takes others.
    """
    found = []
    encoding = root.getroottree().docinfo.encoding
    if encoding is not None and encoding.upper() not in ("UTF-8", "UTF8"):
        found.append(finding("xml-encoding", name, f"the encoding is {encoding}"))
    with _guard:
        xsd = _schema(schema)
        valid, errors = xsd.validate(root), list(xsd.error_log)
    if not valid:
        places = [(f"{name}:{e.line}", printable(e.message)) for e in errors]
        found += [finding("xml-schema", where, what) for where, what in places]
    return found


_guard: Final = threading.Lock()
"""Two threads cannot validate with one schema: libxml2 keeps its state in it."""


@cache
def _schema(schema: str) -> Any:
    return etree.XMLSchema(file=str(_schema_folder() / schema))


def _schema_folder() -> Path:
    """Return FMPy's folder of schemas without importing FMPy, which loads NumPy."""
    package = find_spec("fmpy")
    if package is None or package.origin is None:
        raise InputError(
            "the schemas of FMI are not installed", expected="FMPy", hint="pip install fmpy"
        )
    return Path(package.origin).with_name("schema")


def _line(name: str, error: Exception) -> str:
    line = getattr(error, "lineno", None)
    return name if line is None else f"{name}:{line}"
