"""Read what an FMU declares, without loading its binary."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from cosim.core import AnyPath, InputError, similar_files
from cosim.fmu.export.catalogue import CATALOGUE
from cosim.fmu.feedthrough import Feedthrough, declared_feedthrough
from cosim.fmu.inspect.archive import BROKEN_ARCHIVE, CheckedArchive
from cosim.fmu.inspect.declared_model import XML, DeclaredModel, Interface
from cosim.fmu.inspect.definitions import identifier_findings
from cosim.fmu.inspect.described import describe_root
from cosim.fmu.inspect.findings import Finding, refusal
from cosim.fmu.inspect.markup import MAX_XML, parse_xml
from cosim.fmu.inspect.rules import RULES
from cosim.fmu.inspect.terminals import TERMINALS
from cosim.fmu.port import FmiVersion, Port
from cosim.fmu.port_declarations import declared_ports, unusable
from cosim.fmu.terminal import Terminal, declared_terminals
from cosim.fmu.unit_base import UnitBase

_READ_BY_A_RUN = "VC"
"""Groups of rules about variables and Clocks; a run names in its log which of them are broken."""
_RUN = ("co-simulation", "scheduled execution", "model exchange")
"""Kinds of use, the first that there is first; the last one cannot be run."""


@dataclass(frozen=True, slots=True)
class FmuDescription:
    """The declarations of an FMU: its model description and variables.

        >>> from cosim import build_fmu
        >>> from cosim.fmu import describe_fmu
        >>> fmu = describe_fmu(build_fmu("PaperController"))
        >>> fmu.version, fmu.tool, fmu.can_get_and_set_state
        ('2.0', 'auv-cosim', True)
        >>> [name for name, port in fmu.ports.items() if port.causality == "input"]
        ['x[1]', 'x[2]']

    Attributes
    ----------
    path, sha256 : the file and the hash of its bytes.
    model : the model description, as it is written.
    ports : variable name -> Port; FMI 3's aliases are variables of their own.
    xml : modelDescription.xml as it stands in the FMU.
    version : of FMI; 3.0.1 counts as 3.0. FMI 1.0 is read and run as FMI 2.0 where the two
        agree; its slaves cannot save their state.
    departures : one sentence for each departure of its variables and Clocks from the standard that
        does not keep the FMU from running.
    terminals : by name.
    lengths : the names of the structural parameters that give lengths of arrays.
    units : the units that it defines in base units, by name.
    unusable : variables that are not ports, and why.
    """

    path: Path
    sha256: str
    model: DeclaredModel
    ports: Mapping[str, Port]
    xml: bytes
    version: FmiVersion
    departures: tuple[str, ...] = ()
    terminals: Mapping[str, Terminal] = field(default_factory=lambda: MappingProxyType({}))
    lengths: frozenset[str] = field(init=False, repr=False, compare=False)
    units: Mapping[str, UnitBase] = field(init=False, repr=False, compare=False)
    unusable: Mapping[str, str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        sizes = (size for port in self.ports.values() for size in port.dimensions)
        lengths = frozenset(size for size in sizes if isinstance(size, str))
        object.__setattr__(self, "lengths", lengths)
        defined = ((unit.name, unit.base) for unit in self.model.units)
        units = {name: UnitBase.of(base) for name, base in defined if base is not None}
        object.__setattr__(self, "units", MappingProxyType(units))
        object.__setattr__(self, "unusable", MappingProxyType(unusable(self.model)))

    @property
    def interface(self) -> Interface:
        """The interface that is run: co-simulation if the FMU has it."""
        return _interface_of(self.model)

    @property
    def scheduled(self) -> bool:
        """Whether it is for scheduled execution only: its Clocks activate all it does (FMI 3)."""
        return self.interface.kind == "scheduled execution"

    @property
    def token(self) -> str:
        """The text that the library compares with its own: guid, or instantiationToken."""
        return self.model.token or ""

    @property
    def tool(self) -> str:
        """The tool that made it; empty where it does not say."""
        return self.model.attributes.get("generationTool", "")

    @property
    def variable_step(self) -> bool:
        """Whether the FMU takes communication steps of changing size."""
        return self.scheduled or self._can("canHandleVariableCommunicationStepSize")

    @property
    def can_get_and_set_state(self) -> bool:
        """Whether its state can be saved and restored."""
        return self._can("canGetAndSetFMUstate", "canGetAndSetFMUState")

    @property
    def can_serialize_state(self) -> bool:
        """Whether a saved state can be turned into bytes."""
        return self._can("canSerializeFMUstate", "canSerializeFMUState")

    @property
    def has_event_mode(self) -> bool:
        """Whether its events can be handled in event mode (FMI 3)."""
        return self.version == "3.0" and (self.scheduled or self._can("hasEventMode"))

    @property
    def provides_intermediate_update(self) -> bool:
        """Whether its outputs can be read within a step (FMI 3)."""
        return not self.scheduled and self._can("providesIntermediateUpdate")

    @property
    def can_interpolate_inputs(self) -> bool:
        """Whether it takes derivatives of its inputs (FMI 2)."""
        return self.version == "2.0" and self._can("canInterpolateInputs")

    @property
    def can_be_instantiated_only_once(self) -> bool:
        """Whether there may be only one instance of it in a process at a time."""
        return self._can("canBeInstantiatedOnlyOncePerProcess")

    @property
    def needs_execution_tool(self) -> bool:
        """Whether it runs only with another program, which must be installed."""
        return self._can("needsExecutionTool")

    def _can(self, *attributes: str) -> bool:
        return any(map(self.interface.is_true, attributes))

    def port(self, name: str, *, where: str) -> Port:
        """Return the variable `name`; an `InputError` lists the nearest names if there is none."""
        found = self.ports.get(name)
        self.require_usable(name, where=where)
        if found is None:
            hint = f"cosim fmu info {self.path} lists them"
            raise InputError.unknown("variable", name, self.ports, where=where, hint=hint)
        return found

    def require_usable(self, name: str, *, where: str) -> None:
        """Refuse a variable that cannot be exchanged."""
        if name in self.unusable:
            raise InputError(
                f"{name} cannot be used",
                where=where,
                expected="a variable that its name alone says",
                got=f"in {self.path.name}: {self.unusable[name]}",
            )

    def resized(self, parameters: Mapping[str, Any]) -> FmuDescription:
        """Return the description with the array lengths that structural `parameters` give.

        Raises
        ------
        InputError : a length that is not a natural number, or too many elements.
        """
        lengths = self.lengths
        if lengths.isdisjoint(parameters):
            return self
        values = {}
        for name in lengths:
            value = parameters.get(name, self.ports[name].start)
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or value != value // 1 or value < 0:
                raise InputError(
                    f"{name} is no length of an array",
                    where=str(self.path),
                    expected="an integer, not negative",
                    got=repr(value),
                )
            values[name] = int(value)
        try:
            ports = {name: port.resized(values) for name, port in self.ports.items()}
        except ValueError as error:
            raise InputError(
                "an array is too long", where=str(self.path), got=str(error)
            ) from error
        return replace(self, ports=MappingProxyType(ports))

    def without_events(self) -> FmuDescription:
        """Return the description for a run without event mode: without Clocks that tick."""
        if not any(port.clock is not None or port.clocks for port in self.ports.values()):
            return self
        ports = {
            name: replace(port, clocks=(), kind=None if port.clock is not None else port.kind)
            for name, port in self.ports.items()
        }
        return replace(self, ports=MappingProxyType(ports))

    def with_feedthrough(self, given: Feedthrough | None) -> FmuDescription:
        """Return the description with direct feedthrough as `declared_feedthrough`; None: as it is.

        Raises
        ------
        InputError : a name that is no output.
        """
        if given is None:
            return self
        ports = declared_feedthrough(self.ports, given, where=f"{self.path.name}: feedthrough")
        return replace(self, ports=MappingProxyType(ports))


def describe_fmu(path: AnyPath) -> FmuDescription:
    """Read and validate the model description of an FMU for co-simulation, FMI 1.0, 2.0 or 3.0.

        >>> from cosim import DelaySystem, pack
        >>> from cosim.fmu import describe_fmu
        >>> path = pack(DelaySystem([[-1]], [[1]]), "lag.fmu")
        >>> fmu = describe_fmu(path)
        >>> fmu.version, fmu.ports["u[1]"].causality, fmu.ports["A[1,1]"].start
        ('2.0', 'input', -1.0)

    Raises
    ------
    InputError : no such file, not an FMU, an archive or model identifier that leaves its folder,
        a model description that breaks the standard, or an FMI version or type not supported here.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError("no such FMU", where=str(path), hint=_where_it_may_be(path))
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(
            "the FMU cannot be read", where=str(path), got=error.strerror or str(error)
        ) from error
    key = path, hashlib.sha256(content).hexdigest()
    if key not in _described:
        while len(_described) >= _MOST_KEPT:
            del _described[next(iter(_described))]
        _described[key] = _describe(path, content, key[1])
    return _described[key]


def _where_it_may_be(path: Path) -> str:
    """Return what to do about a file that is not there."""
    similar = similar_files(path)
    if similar is not None:
        return similar
    if path.stem in CATALOGUE:
        return f'build it: python build_fmu.py; a scenario has it by its name: fmu = "{path.stem}"'
    return "a path in a scenario starts from the folder of its file"


_MOST_KEPT = 64
_described: dict[tuple[Path, str], FmuDescription] = {}
"""What was described in this process, by file and hash: the same bytes are read once."""


def _describe(path: Path, content: bytes, digest: str) -> FmuDescription:
    try:
        archive = CheckedArchive(path, content)
        archive.require_sound()
        xml, root = _description_in(archive)
        version = _version(root)
        model, departures = _checked(root, path)
        ports = declared_ports(model, version)
        terminals, broken = _terminals_in(archive)
    except InputError:
        raise
    except BROKEN_ARCHIVE as error:
        raise InputError(
            "not a valid FMU",
            where=str(path),
            expected="an FMU 1.0, 2.0 or 3.0",
            got=str(error),
            hint="an FMU is a zip archive with modelDescription.xml; export or copy it again",
        ) from error
    if _interface_of(model).kind != "co-simulation":  # its variables can be read at any time
        ports = {name: replace(port, clocks=()) for name, port in ports.items()}
    return FmuDescription(
        *(path, digest, model, MappingProxyType(ports), xml, version),
        departures=departures + broken,
        terminals=MappingProxyType(terminals),
    )


def _interface_of(model: DeclaredModel) -> Interface:
    return min(model.interfaces, key=lambda one: _RUN.index(one.kind))


def _description_in(archive: CheckedArchive) -> tuple[bytes, Any]:
    """Return modelDescription.xml, of a bounded size and without entities, and its root."""
    xml = archive.read(XML, MAX_XML)
    root, found = parse_xml(xml, XML)
    for wrong in found:
        raise refusal("not a valid FMU", archive.path, wrong, "XML within limits, without DTD")
    return xml or b"", root


def _terminals_in(archive: CheckedArchive) -> tuple[dict[str, Terminal], tuple[str, ...]]:
    """Return the terminals, and why there are none: the file cannot be read."""
    if TERMINALS not in archive.entries:
        return {}, ()
    root, found = parse_xml(archive.read(TERMINALS, MAX_XML), TERMINALS)
    if root is None:
        return {}, tuple(f"{one.where}: {one.what}" for one in found)
    return declared_terminals(root), ()


def _version(root: Any) -> FmiVersion:
    version = root.get("fmiVersion")
    return version if version in ("1.0", "2.0") else "3.0"


def _checked(root: Any, path: Path) -> tuple[DeclaredModel, tuple[str, ...]]:
    """Return the description and its departures, by the rules of `cosim fmu check`.

    Raises
    ------
    InputError : it breaks a rule without which it cannot be run, or is for model exchange only.
    """
    model, findings = describe_root(root)
    errors = [one for one in findings if one.level == "error"]
    for wrong in errors:
        if not RULES[wrong.code].runs:
            raise refusal("not a valid FMU", path, wrong)
    if model is None:
        raise InputError("not a valid FMU", where=str(path), got=str(root.tag))
    if not model.kinds & {*_RUN[:2]}:
        raise InputError(
            "this FMU cannot be run",
            where=str(path),
            expected="co-simulation, where the FMU brings its own solver",
            got=f"FMI {model.version}, {' and '.join(sorted(model.kinds))} only",
            hint="export it for co-simulation"
            + (", best of FMI 2.0 or 3.0" if model.major == 1 else ""),
        )
    used = _interface_of(model)
    for wrong in identifier_findings(used.identifier, used.kind):
        raise refusal("its library is not loaded", path, wrong, "a C identifier")
    by_rule: dict[str, list[Finding]] = {}
    for one in errors:
        if RULES[one.code].number[0] in _READ_BY_A_RUN:
            by_rule.setdefault(one.code, []).append(one)
    return model, tuple(_departure(listed) for listed in by_rule.values())


def _departure(listed: list[Finding]) -> str:
    """Say how often a rule is broken, and where first."""
    first, more = listed[0], len(listed) - 1
    text = f"{first.where}: {first.what} ({RULES[first.code].number}, {first.code})"
    return f"{text}, and {more} more" if more else text
