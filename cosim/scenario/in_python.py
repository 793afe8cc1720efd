"""A scenario made in Python: parts are added one by one, and may be objects.

It is the same as the TOML: `save` writes it, `Scenario.load` reads it, and what is wrong is said
in the same words.
"""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Self

import tomli_w

from cosim.core import (
    AnyPath,
    InputError,
    Layer,
    cache_folder,
    default_method,
    not_written,
    write_whole,
)
from cosim.fmu import Component, code_of
from cosim.fmu.export import (
    DEFAULT_FLAVOUR,
    ComponentSpec,
    Flavour,
    component_module,
    pack,
    spec_of,
)
from cosim.hinf import Result
from cosim.models import DelaySystem
from cosim.scenario.extend import Source, open_source
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.key_paths import put, split
from cosim.scenario.read import LoadedScenario, loaded_of, with_settings
from cosim.scenario.schema import MADE_WITH, ComponentPart, RunPart

_OF_COMPONENT = tuple(name for name in ComponentPart.model_fields if name != "fmu")


class Scenario:
    """A run as data: its components, links, events and assertions.

        >>> from cosim import DelaySystem, Scenario, analyse, run
        >>> system = DelaySystem(A=[[0.1]], B=[[1]], C=[[1]], D=[[1]])
        >>> scenario = (
        ...     Scenario(step=0.05, until=5)
        ...     .add("plant", system, initial=[1.0])
        ...     .add("controller", analyse(system, [[-1.0]]))
        ...     .link("up", sample_time=0.1, delay=0.2, loss=0.1)
        ...     .connect("plant.x", "controller.x", over="up")
        ...     .connect("controller.u", "plant.u")
        ...     .at(2, lasts=1, outage=["up"])
        ... )
        >>> scenario, run(scenario.set("links.up.loss", 0.2)).status
        (<Scenario scenario: plant, controller; up>, 'finished')

    It cannot be changed: every method returns another scenario. Keys, units and defaults are those
    of the TOML (Reference, Scenarios); `until` is `run.end`.

    Parameters
    ----------
    step, until : communication step and end of the run [s], or texts with a unit.
    title : one line that says what is run.
    name : what it is called in outcomes and traces.
    run : further keys of [run]: `seed`, `start`, `algorithm`, ...

    Raises
    ------
    InputError : by each method, if a key does not exist; by `loaded` and `cosim.run`, if parts do
        not fit together.
    """

    def __init__(
        self,
        *,
        step: float | str,
        until: float | str,
        title: str = "A scenario",
        name: str = "scenario",
        **run: Any,
    ) -> None:
        _known("run", run, [key for key in RunPart.model_fields if key not in ("step", "end")])
        self._name, self._folder = name, Path.cwd()
        self._data: dict[str, Any] = {"title": title, "run": {"end": until, "step": step, **run}}
        self._objects: dict[str, tuple[Any, dict[str, Any]]] = {}

    @classmethod
    def load(cls, name_or_path: AnyPath) -> Self:
        """Read a built-in scenario by name, or a TOML file.

        Raises
        ------
        InputError : no such scenario, or malformed TOML.
        """
        source = open_source(str(name_or_path))
        data, _ = source.written_out()
        return cls.of_data(data, name=source.name, folder=source.folder)

    @classmethod
    def of_data(cls, data: Mapping[str, Any], *, name: str, folder: Path | None = None) -> Self:
        """Return a scenario of tables, as TOML has them.

        folder : the start of relative paths; None: the folder of the process.
        """
        empty = cls(step=0, until=0, name=name)
        vars(empty).update(_data=copy.deepcopy(dict(data)))
        vars(empty).update({} if folder is None else {"_folder": folder})
        return empty

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scenario):
            return NotImplemented
        return (self._data, self._objects) == (other._data, other._objects)

    __hash__ = None  # type: ignore[assignment] # compared by what is in it

    def __repr__(self) -> str:
        components = ", ".join(self._data.get("components", {}))
        links = ", ".join(self._data.get("links", {})) or "no links"
        return f"<Scenario {self._name}: {components or 'no components'}; {links}>"

    def add(
        self,
        name: str,
        what: Any,
        *,
        parameters: Mapping[str, Any] | None = None,
        **settings: Any,
    ) -> Self:
        """Add a component.

        Parameters
        ----------
        name : of the component.
        what : a built-in FMU by name or any `.fmu` by its path, as in TOML; or what `cosim.pack`
            takes: a system (its plant), a design (its controller), a vehicle. With the system of
            the design as another component, the run is judged by its proof. Or a `Component` in
            Python, an object or its class.
        parameters : start values and parameters by FMI name.
        settings : further keys of [components.NAME] (`step`, `event_mode`, ...), and those of
            `cosim.pack` (`initial` of a system; `sample_time`, `limits` of a design).
        """
        data, objects = self.to_data(), dict(self._objects)
        part = {key: settings.pop(key) for key in _OF_COMPONENT if key in settings}
        if parameters:
            part["parameters"] = dict(parameters)
        if isinstance(what, str | PathLike):
            _known(f"components.{name}", settings, _OF_COMPONENT)
            part["fmu"] = str(what)
        else:
            if isinstance(what, type) and issubclass(what, Component):
                what = what()
            _spec(what, "checked", settings)  # what cannot fly is refused here
            objects[name] = what, settings
        data.setdefault("components", {})[name] = part
        return self._with(data, objects)

    def connect(self, source: str, target: str, *, over: str | None = None, **keys: Any) -> Self:
        """Connect an output to an input, or a group to a group, over a link.

        keys : of [[connections]]: `gain`, `offset`, `matrix`, `sensor`, `add`, `policy`.
        """
        link = {} if over is None else {"link": over}
        return self._listed("connections", {"from": source, "to": target, **link, **keys})

    def link(self, name: str, *, kind: str = "packet", **keys: Any) -> Self:
        """Add a link; keys as of [links.NAME]: `sample_time`, `delay`, `loss`, `jitter`, ...

        kind : "packet", or "transport" for a continuous signal that is delayed.
        """
        return self.set(f"links.{name}", {"kind": kind, **keys})

    def at(self, time: float | str, *, lasts: float | str | None = None, **actions: Any) -> Self:
        """Let something happen at a time [s]; its effect is undone when the event is over.

        lasts : how long [s]; None: to the end.
        actions : of [[events]]: `set`, `override`, `bias`, `outage`, `delay`, `loss`, `stop`, ...
        """
        during = {} if lasts is None else {"for": lasts}
        return self._listed("events", {"at": time, **during, **actions})

    def when(self, condition: str, *, lasts: float | str | None = None, **actions: Any) -> Self:
        """Let something happen when a condition becomes true, as "plant.x[1] > 2"."""
        during = {} if lasts is None else {"for": lasts}
        return self._listed("events", {"when": condition, **during, **actions})

    def require(self, always: str | None = None, **keys: Any) -> Self:
        """Say what must hold: `always`, or another key of [[assertions]], as `eventually`."""
        given = {} if always is None else {"always": always}
        return self._listed("assertions", {**given, **keys})

    def set(self, key: str, value: Any) -> Self:
        """Set a key by its dotted path, as `--set`: "links.up.delay", "run.seed", "modes.mission".

        Raises
        ------
        InputError : a path through something that is not a table.
        """
        data, objects = self.to_data(), dict(self._objects)
        path = split(key)
        put(data, path, _plain(value), f"set({key!r})")
        if path[0] == "components" and path[2:] == ("fmu",):
            objects.pop(str(path[1]), None)
        return self._with(data, objects)

    def with_design(self, design: Result) -> Self:
        """Use this design as [design], in place of instructions to make or find one."""
        data = self.to_data()
        part = {key: x for key, x in data.get("design", {}).items() if key not in MADE_WITH}
        data["design"] = {**part, "file": str(_kept_design(design))}
        return self._with(data, self._objects)

    def to_data(self) -> dict[str, Any]:
        """Return the tables, as TOML has them; components that are objects without `fmu`."""
        return copy.deepcopy(self._data)

    def save(self, path: AnyPath, *, flavour: Flavour = DEFAULT_FLAVOUR) -> Path:
        """Write the scenario as TOML; objects become files beside it. Return its path.

        Raises
        ------
        InputError : parts that do not fit, or a file that cannot be written.
        """
        target = Path(path)
        data = self.to_data()
        for name, (what, settings) in self._objects.items():
            if isinstance(what, Component):
                raise InputError(
                    "Python code has no file",
                    where=f"components.{name}",
                    expected="a scenario of FMUs, systems and designs",
                    got=type(what).__name__,
                )
            packed = pack(what, target.parent / f"{name}.fmu", flavour=flavour, **settings)
            data["components"][name]["fmu"] = packed.name
        if (found := self._judged()) is not None:
            controller, plant, design = found
            file = design.save(target.parent / f"{controller}.json")
            data["design"] = {"file": file.name, "controller": controller, "plant": plant}
        with not_written("the scenario", target):
            write_whole(target, tomli_w.dumps(data).encode())
        return target

    def source(self, flavour: str = DEFAULT_FLAVOUR) -> Source:
        """Return the scenario as from a file: objects become FMUs, a design a file, in the cache.

        Raises
        ------
        InputError : an object that cannot be packed.
        """
        data = self.to_data()
        cache = FmuCache(Path("fmus"), self._folder, flavour=flavour)
        for name, (what, settings) in self._objects.items():
            made = cache.made(_spec(what, name, settings), f"components.{name}")
            data["components"][name]["fmu"] = str(made.path)
            if isinstance(what, Component):
                data["components"][name].setdefault("parameters", {}).update(
                    code_of(what).parameters
                )
        if (found := self._judged()) is not None:
            controller, plant, design = found
            file = str(_kept_design(design))
            data["design"] = {"file": file, "controller": controller, "plant": plant}
        if self.flies_here_alone:
            data["run"]["supervise"] = False
        text = tomli_w.dumps(data)
        return Source(self._name, data, (Layer(f"{self._name}.toml", text),), self._folder)

    @property
    def has_code(self) -> bool:
        """Whether a component is Python code, which flies in this process or in a fork of it."""
        return any(isinstance(what, Component) for what, _ in self._objects.values())

    @property
    def flies_here_alone(self) -> bool:
        """Whether a child of this process would not have its code: one that is no fork of it."""
        return self.has_code and default_method() != "fork"

    def check_forks(self, processes: str, where: str, instead: str) -> None:
        """Refuse other processes that would not have the Python code of this scenario.

        processes : what they are; where : who asks for them; instead : what can be done.
        """
        if self.flies_here_alone:
            raise InputError(
                f"{processes} would not have the Python code of this scenario",
                where=where,
                expected=f"{instead}, or a process that can be forked",
                got="one with other threads or with libraries of FMUs, or a system without fork",
            )

    def loaded(
        self, flavour: str = DEFAULT_FLAVOUR, settings: Sequence[str] = ()
    ) -> LoadedScenario:
        """Return the scenario as it is read and validated, with KEY=VALUE settings.

        Raises
        ------
        InputError : it breaks the schema, with the place in its TOML.
        """
        return loaded_of(with_settings(self.source(flavour), settings))

    def _judged(self) -> tuple[str, str, Result] | None:
        """Return controller, plant and design of a loop whose proof judges the run.

        There is one where a design is added and its own system is another component, unless
        [design] says something else.
        """
        if "design" in self._data:
            return None
        for name, (design, settings) in self._objects.items():
            if isinstance(design, Result) and not settings.get("observer"):
                for other, (what, _) in self._objects.items():
                    if isinstance(what, DelaySystem) and what == design.system:
                        return name, other, design
        return None

    def _with(self, data: dict[str, Any], objects: dict[str, tuple[Any, dict[str, Any]]]) -> Self:
        made = copy.copy(self)
        vars(made).update(_data=data, _objects=objects)
        return made

    def _listed(self, key: str, part: dict[str, Any]) -> Self:
        data = self.to_data()
        data.setdefault(key, []).append(_plain(part))
        return self._with(data, self._objects)


def _spec(what: Any, name: str, settings: dict[str, Any]) -> ComponentSpec:
    """Specify the FMU of an object; of a component in Python, the shell that calls it."""
    if not isinstance(what, Component):
        return spec_of(what, name, **settings)
    _known(f"components.{name}", settings, _OF_COMPONENT)
    code_of(what)
    shell: ComponentSpec = component_module("python_code.variables").python_code_spec(
        name, what.inputs, what.outputs
    )
    return shell


def _kept_design(design: Result) -> Path:
    """Return the file of a design in the user's cache, by its content."""
    text = design.file_text()
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    path = cache_folder() / "designs" / f"{digest}.json"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text.encode())
    return path


def _plain(value: Any) -> Any:
    """Return a value as TOML has it: arrays as lists, numbers of NumPy as Python's."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return value


def _known(where: str, given: Mapping[str, Any], known: Any) -> None:
    other = [key for key in given if key not in known]
    if other:
        raise InputError.unknown("key", other[0], known, where=where)
