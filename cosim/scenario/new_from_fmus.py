"""A new scenario of some FMUs: what fits is wired, what does not is said in its comments."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import tomli_w

from cosim.core import AnyPath, CosimError, InputError, counted
from cosim.fmu import FmuDescription
from cosim.fmu.export import CATALOGUE
from cosim.scenario.check import problems_of
from cosim.scenario.experiment import MOST_STEPS, Experiment, experiment_of
from cosim.scenario.extend import source_of
from cosim.scenario.fields import NAME_PATTERN
from cosim.scenario.fitting import Fitting, FittingWire, fitting_of
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.schema import connection_of

_LINK = """\
# The link of a slow modem: change it to yours.
[links.{name}]
kind = "packet"                # messages; "transport": a continuous signal, delayed
sample_time = {sample_time}              # seconds between two messages
delay = 0.3                    # or {{ range = [...], from = [...] }}, or recorded
loss = 0.05                    # or {{ p_enter = 0.05, p_exit = 0.3 }}: in bursts
"""
_LINK_SAMPLE_TIME = 0.2


@dataclass(frozen=True)
class NewScenario:
    """The text of a new scenario, and what it says.

    Attributes
    ----------
    text : TOML.
    fitting : which inputs are wired, and why others are not.
    fmus : component -> its FMU, as the scenario names it.
    link : of the connections; None: they are direct.
    problems : what `cosim scenario check` finds; nothing, unless an FMU itself cannot be run here.
    """

    text: str
    fitting: Fitting
    fmus: Mapping[str, str]
    link: str | None
    problems: tuple[CosimError, ...]

    @property
    def summary(self) -> str:
        """What is wired, in words."""
        return f"{counted(len(self.fmus), 'FMU')}, {self.fitting.summary}"


@dataclass(frozen=True)
class _Cut:
    """How an algebraic loop is computed: keys of [run] with a remark, or which wires are late."""

    remark: str = ""
    keys: str = ""
    late: frozenset[FittingWire] = frozenset()


def scenario_from_fmus(
    name: str,
    fmus: Sequence[AnyPath],
    *,
    folder: AnyPath = ".",
    link: str | None = None,
    cache: FmuCache | None = None,
) -> NewScenario:
    """Return a new scenario of some FMUs, in which what fits is wired.

        >>> from pathlib import Path
        >>> from cosim.scenario import scenario_from_fmus
        >>> new = scenario_from_fmus("loop", ["PaperController", "DelayedPlant"])
        >>> new.summary
        '2 FMUs, 3 of 4 inputs wired'
        >>> [f"{one.target}: {one.why}" for one in new.fitting.open_inputs]
        ['DelayedPlant.w[1]: no output has this name']

    Parameters
    ----------
    name : of the scenario.
    fmus : paths of FMUs, or names of built-in ones.
    folder : of the scenario's file: paths in it start there.
    link : name of a link for all connections but those of Clocks; None: direct ones.
    cache : where built-in FMUs are found or built.

    Raises
    ------
    InputError : an FMU that cannot be read or run, or the name of the link is none.
    """
    folder = Path(folder).absolute()
    cache = replace(cache or FmuCache(Path("fmus")), folder=folder)
    if link is not None and not re.fullmatch(NAME_PATTERN, link):
        expected = "a letter, then letters, digits, _ or -"
        raise InputError("not a valid name for a link", where=link, expected=expected)
    references = _named([_reference(fmu, folder) for fmu in fmus], {link})
    described = {component: cache.find(fmu) for component, fmu in references.items()}
    fitting, times = fitting_of(described), experiment_of(described)
    writer = _Writer(name, references, described, fitting, times, link)
    tried: list[tuple[str, list[CosimError]]] = []
    for cut in _cuts(described, fitting):
        text = writer.text(cut)
        problems = problems_of(source_of(text, name=name, where=name, folder=folder), cache)
        tried.append((text, problems))
        if not any(isinstance(problem, InputError) for problem in problems):
            break
    else:
        tried = tried[:1]
    text, problems = tried[-1]
    return NewScenario(text, fitting, references, link, tuple(problems))


def is_fmu(text: str) -> bool:
    """Whether a word names an FMU: the path of one, or a built-in one."""
    return text.endswith(".fmu") or text in CATALOGUE


def default_name(fmus: Sequence[str]) -> str:
    """Return the name of a scenario of these FMUs: those of the first three of them."""
    return "-".join(list(_named(fmus, set()))[:3])


def _reference(fmu: AnyPath, folder: Path) -> str:
    """Return an FMU as a scenario in a folder names it."""
    if str(fmu) in CATALOGUE:
        return str(fmu)
    path = Path(fmu).absolute()
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # on another drive
        return path.as_posix()


def _named(fmus: Sequence[str], taken: set[str | None]) -> dict[str, str]:
    """Return the components of these FMUs, by names made of those of their files."""
    found: dict[str, str] = {}
    for fmu in fmus:
        stem = re.sub(r"[^A-Za-z0-9_-]+", "_", Path(fmu).stem).strip("_-")
        base = stem if re.fullmatch(NAME_PATTERN, stem) else f"fmu_{stem}".rstrip("_")
        names = (base, *(f"{base}_{k}" for k in range(2, len(fmus) + len(taken) + 2)))
        found[next(one for one in names if one not in found and one not in taken)] = fmu
    return found


def _cuts(fmus: Mapping[str, FmuDescription], fitting: Fitting) -> Iterator[_Cut]:
    """Give the ways to compute algebraic loops: none is needed where there is no loop."""
    yield _Cut()
    ports = (p for fmu in fmus.values() for p in fmu.ports.values())
    if not all(p.feedthrough_declared for p in ports):
        yield _Cut(
            "FMUs do not say which outputs depend on which inputs: a loop is cut by one step",
            'unknown_feedthrough = "previous"',
        )
    if all(fmu.can_get_and_set_state for fmu in fmus.values()):
        yield _Cut("an algebraic loop is solved at every point", "solve = true")
    late = frozenset(wire for wire in fitting.wires if _returns(wire, fitting))
    yield _Cut("", "", late)


def _returns(wire: FittingWire, fitting: Fitting) -> bool:
    """Whether the receiver of a connection is among what its sender depends on."""
    reached, before = {wire.target.component}, 0
    while len(reached) != before:
        before = len(reached)
        reached |= {w.target.component for w in fitting.wires if w.source.component in reached}
    return wire.source.component in reached


@dataclass(frozen=True)
class _Writer:
    """Writes the scenario, given how its loops are computed."""

    name: str
    references: Mapping[str, str]
    fmus: Mapping[str, FmuDescription]
    fitting: Fitting
    times: Experiment
    link: str | None

    def text(self, cut: _Cut) -> str:
        """Return the text."""
        parts = [self._head(), self._connect(cut), self._run(cut), self._components()]
        parts.append(self._long(cut))
        if self.link is not None:
            sample_time = max(_LINK_SAMPLE_TIME, self.times.step_ns / 1e9)
            parts.append(_LINK.format(name=self.link, sample_time=f"{sample_time:<3.12g}"))
        return "\n".join(part for part in parts if part)

    def _head(self) -> str:
        summary = f"{counted(len(self.fmus), 'FMU')}, {self.fitting.summary}"
        lines = [
            f"{summary}. An input takes the one output that",
            "fits it by name, or by terminal and member, and has its type, size and unit.",
            f"  cosim scenario check {self.name}.toml",
            f"  cosim run {self.name}.toml",
            *(f"not wired: {one.target}: {one.why}" for one in self.fitting.open_inputs),
        ]
        comments = "".join(f"# {_one_line(line)}\n" for line in lines)
        return f"{comments}schema = 1\ntitle = {_quoted(', '.join(self.fmus))}\n"

    def _connect(self, cut: _Cut) -> str:
        """Return the connections in their short form, and below them what could be added."""
        lines = [
            f"    {_quoted(text)},"
            for wire in self.fitting.wires
            if (text := self._short(wire, cut)) is not None
        ]
        link = f" : {self.link}" if self.link is not None else ""
        lines += [
            f"    # {_one_line(_quoted(f'{source} -> {one.target}{link}'))},  # has its unit"
            for one in self.fitting.open_inputs
            for source in one.possible
        ]
        return "connect = [\n" + "\n".join(lines) + "\n]\n" if lines else ""

    def _short(self, wire: FittingWire, cut: _Cut) -> str | None:
        """Return a connection in its short form; None if it has none."""
        if wire.converted is not None or wire in cut.late:
            return None
        link = self._link_of(wire)
        text = f"{wire.source} -> {wire.target}" + (f" : {link}" if link else "")
        try:
            read = connection_of(text)
        except ValueError:
            return None
        ends = str(wire.source), str(wire.target), link
        return text if (read.source, read.target, read.link) == ends else None

    def _long(self, cut: _Cut) -> str:
        """Return the other connections, as tables."""
        tables = []
        for wire in self.fitting.wires:
            if self._short(wire, cut) is not None:
                continue
            remark = "" if wire.converted is None else f"  # {_one_line(wire.converted)}"
            keys = {"from": str(wire.source), "to": str(wire.target)}
            lines = [f"{key} = {_quoted(value)}\n" for key, value in keys.items()]
            if (link := self._link_of(wire)) is not None:
                lines.append(f'link = "{link}"\n')
            if wire.converted is not None:
                lines.append(f"gain = {wire.gain!r}{remark}\n")
            if wire.offset:
                lines.append(f"offset = {wire.offset!r}\n")
            if wire in cut.late:
                lines.append('policy = "previous"  # cuts an algebraic loop\n')
            tables.append("[[connections]]\n" + "".join(lines))
        return "\n".join(tables)

    def _link_of(self, wire: FittingWire) -> str | None:
        return None if wire.is_clock else self.link

    def _run(self, cut: _Cut) -> str:
        times, lines = self.times, ["[run]"]
        if times.start_ns:
            lines.append(f"start = {times.start_ns / 1e9!r}")
        cut_short = f"  # seconds; the FMUs say later, here are {MOST_STEPS} steps"
        cut_short = cut_short if times.is_cut else "  # seconds"
        lines.append(f"end = {times.end_ns / 1e9!r}{cut_short}")
        declared = f"  # declared by {', '.join(times.step_from)}" if times.step_from else ""
        lines.append(f"step = {times.step_ns / 1e9!r}{declared}")
        if self.link is not None and not all(fmu.variable_step for fmu in self.fmus.values()):
            lines.append('events = "grid"  # an FMU takes steps of one size only')
        if cut.keys:
            lines.append(f"{cut.keys}  # {cut.remark}")
        return "\n".join(lines) + "\n"

    def _components(self) -> str:
        tables, seen = [], set()
        for name, fmu in self.fmus.items():
            lines = [f"[components.{name}]", f"fmu = {_quoted(self.references[name])}"]
            if name in self.times.own_steps:
                lines.append(f"step = {self.times.own_steps[name] / 1e9!r}  # declared by it")
            if name in self.times.odd:
                lines.append(f"# it declares a step of {self.times.odd[name] / 1e9!r} s")
            if fmu.sha256 in seen and fmu.can_be_instantiated_only_once:
                lines.append("isolate = true  # one instance per process")
            seen.add(fmu.sha256)
            tables.append("\n".join(lines) + "\n")
        return "\n".join(tables)


def _quoted(text: str) -> str:
    """Return a text as TOML writes it."""
    return tomli_w.dumps({"x": text}).removeprefix("x = ").rstrip("\n")


def _one_line(text: str) -> str:
    """Return a text without what ends a comment of TOML."""
    return "".join(c if c.isprintable() else "\ufffd" for c in text)
