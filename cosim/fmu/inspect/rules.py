"""Every kind of finding: its usual level, why it matters, what to do.

Sections are of the FMI standards 2.0.4 and 3.0.2.
"""

from __future__ import annotations

from functools import partial
from types import MappingProxyType
from typing import Literal, NamedTuple


class Rule(NamedTuple):
    """The usual level of a finding and why it matters."""

    level: Literal["error", "warning", "note"]
    why: str


_error = partial(Rule, "error")
_warning = partial(Rule, "warning")
_note = partial(Rule, "note")

_ARCHIVE = {
    "path-backslash": _error(
        "ZIP paths have forward slashes; other systems make a file with a strange name of this: "
        "pack again with forward slashes"
    ),
    "path-escapes": _error(
        "an absolute path, a drive letter or '..' writes outside the folder it is unpacked to: "
        "do not unpack this file; pack again with relative paths"
    ),
    "path-control": _error("such a path cannot be unpacked everywhere: rename it"),
    "entry-twice": _error(
        "tools take the first or the last of them, so that two people load two models: keep one"
    ),
    "entry-case": _error("on Windows and macOS one overwrites the other: rename one"),
    "entry-link": _error("a link may point outside the FMU, and many tools refuse it: pack files"),
    "entry-encrypted": _error("no FMI tool asks for a password: pack without encryption"),
    "entry-method": _error("FMI allows stored and deflated entries only: pack with deflate"),
    "entry-damaged": _error("the entry does not unpack to what was packed: get the file again"),
    "archive-bomb": _error(
        "it unpacks to far more than its size; it was not unpacked: load it only if you know why"
    ),
}

_XML = {
    "xml-malformed": _error("no tool can read it: correct the XML"),
    "xml-doctype": _error("FMI has no DTD, and entities can be abused: remove the DOCTYPE"),
    "xml-large": _error("it is larger than the limit here; it was not read"),
    "xml-schema": _error("it breaks the XML schema of the standard, and strict tools refuse it"),
    "version-unknown": _error("fmiVersion must be 1.0, 2.0 or 3.0: no other is known here"),
    "fmpy-refuses": _error("FMPy, a widely used importer, cannot read it"),
}

_MODEL = {
    "identifier": _error(
        "modelIdentifier names the binary and must be a C identifier (FMI 2.0.4, 2.2.1)"
    ),
    "kind-none": _error("it offers neither co-simulation nor another use: declare one"),
    "token-empty": _error(
        "the binary compares guid/instantiationToken with its own to refuse a foreign "
        "description: give one"
    ),
    "name-twice": _error("variables are addressed by name: rename one"),
    "name-structure": _error(
        "it does not follow variableNamingConvention='structured' (FMI 2.0.4, 2.2.9): "
        "rename it, or declare 'flat'"
    ),
    "name-control": _error("a name has no carriage return, line feed or tab: rename it"),
    "start-missing": _error("a variable that is set, or exact at the start, needs a start value"),
    "start-superfluous": _error("a calculated variable, or time, has no start value: remove it"),
    "start-number": _warning("a start that is not finite spreads into every result: correct it"),
    "start-range": _error("the FMU starts with a value it forbids itself: correct start or range"),
    "start-item": _error("an enumeration starts at one of its items: correct it"),
    "start-length": _error("an array has one start per element, or one for all: correct it"),
    "range-empty": _error("no value is allowed when min is greater than max: correct them"),
    "nominal": _warning("a nominal value of 0 cannot scale a tolerance: give a size, or none"),
    "combination": _error(
        "this causality, variability and initial do not go together "
        "(FMI 2.0.4, 2.2.7; FMI 3.0.2, 2.4.7.5)"
    ),
    "not-continuous": _error("only floating-point variables are continuous: make it discrete"),
    "reference-twice": _error("in FMI 3 a value reference belongs to one variable: renumber"),
    "reference-types": _note(
        "legal in FMI 2, where a value reference is unique per type only, but simple tools mix "
        "them up: number through"
    ),
    "alias-unit": _error("aliases are one memory cell, so their units must agree"),
    "alias-start": _error("aliases are one memory cell, so their starts must agree"),
    "alias-settable": _error("of a set of aliases at most one is an input or a parameter"),
    "unit-undefined": _error("a unit that is used is defined in UnitDefinitions: define it"),
    "unit-display": _error("a display unit is defined beside its unit: define it"),
    "unit-base": _warning(
        "the base-unit exponents, factor or offset contradict the unit's name; a tool that "
        "converts units computes wrong numbers: correct them"
    ),
    "unit-open": _note(
        "without BaseUnit a tool cannot check connections or convert: give SI exponents"
    ),
    "unit-none": _note("nobody can check what an input or output without a unit is: give units"),
    "type-undefined": _error("a declared type is defined in TypeDefinitions: define it"),
    "derivative": _error("the attribute derivative names the state: correct it"),
    "dimension": _error("an array's size is a number or a structural parameter that exists"),
    "clock": _error("a clocked variable names clocks that exist"),
    "independent": _error("FMI 3 has exactly one independent variable: declare time once"),
    "experiment": _warning("a default experiment that cannot be run misleads: correct it"),
}

_STRUCTURE = {
    "structure-dangling": _error(
        "ModelStructure points to a variable that does not exist: correct it"
    ),
    "structure-outputs": _error("ModelStructure lists exactly the outputs: correct it"),
    "structure-derivative": _error("a derivative listed in ModelStructure names its state"),
    "structure-initial": _error(
        "tools solve the initial equations in this list: list exactly the calculated outputs, "
        "calculated parameters and states"
    ),
    "dependency-dangling": _error("a dependency points to a variable that does not exist"),
    "dependency-kind": _error("each dependency has one kind: correct dependenciesKind"),
    "dependency-known": _warning(
        "an output depends on inputs, states and (at the start) parameters, not on this"
    ),
    "dependency-open": _note(
        "without dependencies a tool must assume that the output depends on every input, and "
        "may see an algebraic loop that is not there: write them, empty for none"
    ),
}

_CONTENT = {
    "binary-none": _error("it has neither a binary nor sources: nothing can run it"),
    "binary-sources-only": _warning("sources alone run only where they are compiled: compile"),
    "binary-here": _warning("it cannot run on this machine as it is: compile, or ask for one"),
    "binary-name": _error("a tool loads binaries/<platform>/<modelIdentifier>, and finds nothing"),
    "binary-folder": _warning("no tool looks into a folder of this name: rename it"),
    "binary-folder-tuple": _note("FMI 2 names no such platform; only some tools look there"),
    "binary-damaged": _error("no operating system loads it as a library: build it again"),
    "binary-unread": _warning(
        "its reader here failed, so it was not checked; that says nothing about the file: report "
        "it, with the file"
    ),
    "binary-unexamined": _note(
        "the headers of libraries were not read, so that their platforms, functions and needs are "
        "not checked: pip install 'auv-cosim[check]'"
    ),
    "binary-platform": _error("it is built for another machine than its folder says: move it"),
    "function-missing": _error("without this function nothing can run it: build it again"),
    "function-optional": _warning(
        "the standard asks for every function, and importers that look each up refuse the FMU: "
        "export it, returning an error"
    ),
    "needs-python": _warning(
        "it calls into a Python interpreter that it does not load itself: only Python programs "
        "can host it, others end with an undefined symbol; declare needsExecutionTool='true'"
    ),
    "needs-tool": _note("it runs only where the tool that made it is installed"),
    "library-absent": _warning(
        "the library is neither in the FMU nor part of the system: link it in, or pack it beside"
    ),
    "library-unreached": _warning(
        "the library is packed, but the loader is not told to look there: link with $ORIGIN "
        "(rpath), @loader_path on macOS"
    ),
    "library-path": _warning("an absolute path of the builder's machine is found nowhere else"),
    "library-debug": _warning("debug runtimes are not redistributable: build it as Release"),
    "libc-version": _note("older systems refuse it: build against an older C library"),
    "libc-here": _warning("it does not load on this machine: build against an older C library"),
    "stack-executable": _warning(
        "new systems refuse to load a library with an executable stack: link with -z noexecstack"
    ),
    "symbols-open": _note(
        "two FMUs with the same other symbols may call each other's code: hide all but FMI's"
    ),
    "once-per-process": _note("a second instance in one process is refused or shares state"),
    "sources-missing": _error("a source file that is listed is not packed: compiling fails"),
    "sources-unlisted": _warning("sources that no description lists are compiled by no tool"),
    "documentation": _note("a person who opens it finds no text: add documentation/index.html"),
}

_RUN = {
    "run-absent": _warning("there is no binary for this machine, so nothing was run"),
    "run-done": _note("it was set up, stepped and ended on this machine"),
    "run-kind": _note("this kind of FMU was only set up and ended"),
    "run-load": _error("the operating system does not load the binary"),
    "run-crash": _error("the FMU ends the whole process: run it isolated, report it to its maker"),
    "run-timeout": _error("the FMU did not return in time: allow more, or report it to its maker"),
    "run-refused": _error("the FMU refuses a call that the standard allows here"),
    "run-broken": _error("the probe could not call the FMU as the standard says"),
    "run-not-finite": _warning("outputs that are not finite make every result worthless"),
    "run-state": _warning("a restored state does not continue as the saved one did"),
    "run-serialized": _warning("a state from bytes does not continue as the saved one did"),
    "run-reset": _warning("after a reset the same steps give other outputs"),
    "run-start": _warning("the binary starts at another value than its description says"),
    "run-log": _note("a log message of the FMU"),
    "run-end": _error("the FMU fails after its work is done: report it to its maker"),
}

RULES: MappingProxyType[str, Rule] = MappingProxyType(
    _ARCHIVE | _XML | _MODEL | _STRUCTURE | _CONTENT | _RUN
)
"""Code -> level and reason."""
