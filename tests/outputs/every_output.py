"""Every output of the command line, and a command that writes it."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from chaos.command import run_quietly
from cli.commands import every_command

from cosim.core import InputError

_KINDS: Mapping[frozenset[str], str] = MappingProxyType(
    {
        frozenset({"a file", "a device"}): "file",
        frozenset({"a file", "a device", "a folder"}): "file",  # one, or several in a folder
        frozenset({"a file"}): "trace",
        frozenset({"a folder"}): "folder",
    }
)
"""What is taken as the place of an output while options are read, and what is then written."""
_OUTPUT = re.compile(r"--(out|save(-\w+)?|picture|html)")


class Output(NamedTuple):
    """An output of a command.

    Attributes
    ----------
    verb, option : of the command.
    suffix : of its file.
    arguments : of the command, by the folder of what it reads.
    kind : of what is written.
    usual : exit code of the command.
    slow : whether it takes more than some seconds.
    needs : a module without which it is not written.
    """

    verb: str
    option: str
    suffix: str
    arguments: Callable[[Path], tuple[Any, ...]]
    kind: Literal["file", "trace", "folder"] = "file"
    usual: int = 0
    slow: bool = False
    needs: str | None = None

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.verb} {self.option} {self.suffix}".strip()


def _of(*arguments: str) -> Callable[[Path], tuple[Any, ...]]:
    """Arguments, of which @NAME is a file of the stock."""
    return lambda stock: tuple(str(stock / a[1:]) if a.startswith("@") else a for a in arguments)


_SYSTEMS = Path(__file__).parents[1] / "corpus" / "systems"
_BELOW = ("--k1", "0.6", "--k2", "0.2", "--gamma", "4.9", "--order", "theorem-2")
_GAIN = ("--gain", "[[-3,-3]]", "--order", "0")
_RUN = ("paper-example", "--until", "1")
OUTPUTS: tuple[Output, ...] = (
    Output("run", "--out", ".mcap", _of(*_RUN, "--fmus", "@fmus"), "trace"),
    Output("trace rerun", "--out", ".mcap", _of("@t.mcap", "--fmus", "@fmus"), "trace"),
    Output(
        *("trace inject", "--out", ".mcap"),
        _of("@t.mcap", "--into", "@plant.fmu", "--as-component", "plant", "--fmus", "@fmus"),
        "trace",
    ),
    Output("study repeat", "--out", ".mcap", _of("@study", "0", "--fmus", "@fmus"), "trace"),
    Output("trace recover", "--out", ".mcap", _of("@cut.mcap.partial", "--force"), usual=3),
    Output("trace report", "--out", ".html", _of("@t.mcap")),
    Output("trace layout", "--out", ".json", _of("@t.mcap")),
    Output("trace export", "--out", ".csv", _of("@t.mcap", "--wide")),
    Output("trace export", "--out", ".mat", _of("@t.mcap")),
    Output("trace export", "--out", ".parquet", _of("@t.mcap", "--wide", "--to", "parquet")),
    Output("trace export", "--out", ".mcap", _of("@t.mcap")),
    Output("trace view", "--save", ".rrd", _of("@t.mcap"), needs="rerun"),
    Output("trace diff", "--picture", ".png", _of("@linked.mcap", "@other.mcap"), usual=1),
    Output("link record", "--out", ".csv", _of("@linked.mcap", "--link", "uplink")),
    Output("link show", "--picture", ".png", _of("@link.csv")),
    Output("link fit", "--out", ".toml", _of("@link.csv")),
    Output("design", "--save", ".json", _of("@system.toml")),
    Output("design", "--save-norm", ".json", _of("@system.toml")),
    Output(
        "design",
        "--save-refutation",
        ".json",
        _of("@system.toml", "--k1", "0.6", "--k2", "0.2", "--gamma", "0.01"),
        usual=5,
    ),
    Output("analyse", "--save", ".json", _of("@system.toml", *_GAIN)),
    Output("analyse", "--save-norm", ".json", _of("@system.toml", *_GAIN)),
    Output("age", "--picture", ".png", _of("@system.toml"), slow=True),
    Output("certificate prove", "--save", ".json", _of("@design.json", "--hold", "0.1")),
    Output("paper", "--html", ".html", _of(), slow=True),
    Output("fmu build", "--out", ".fmu", _of("paper")),
    Output("fmu controller", "--out", ".fmu", _of("@design.json")),
    Output("ssp export", "--out", ".ssp", _of("paper-example", "--fmus", "@fmus")),
    Output("ssp import", "--out", ".toml", _of("@scenario.ssp")),
    Output("study show", "--picture", ".png", _of("@study")),
    Output("study report", "--out", ".html", _of("@study")),
    Output("vehicle show", "--picture", ".png", _of("remus100")),
    Output("demo", "--out", "", _of("--fmus", "@fmus"), "folder", slow=True),
    Output("vehicle fly", "--out", "", _of("remus100", "--fmus", "@fmus"), "folder", slow=True),
    Output("study run", "--out", "", _of("@study.toml", "--fmus", "@fmus"), "folder"),
    Output("study merge", "--out", "", _of("@study"), "folder"),
)


def options_of_outputs(folder: Path) -> Iterator[tuple[str, str, str | None]]:
    """Every option of the command line that names an output: verb, option, kind of the output.

    The kind is what its places are judged as while options are read; None: nothing judges them.

    folder : an empty one, for places to be judged.
    """
    (folder / "file").touch()
    places = {"a file": folder / "file", "a folder": folder, "a device": Path(os.devnull)}
    for found in every_command():
        for parameter in found.command.params:
            option = next((each for each in parameter.opts if _OUTPUT.fullmatch(each)), None)
            if option is not None:
                taken = frozenset(name for name, it in places.items() if _takes(parameter, it))
                yield found.words, option, _KINDS.get(taken)


def _takes(parameter: Any, place: Path) -> bool:
    """Whether an option takes a place while it is read."""
    if parameter.callback is None:
        return True
    try:
        parameter.callback(None, parameter, place)
    except InputError:
        return False
    return True


def make_stock(folder: Path) -> None:
    """Make what the commands read."""

    def made(*line: str) -> None:
        run_quietly(*line, folder=folder)

    shutil.copyfile(_SYSTEMS / "own-delay.toml", folder / "system.toml")
    (folder / "study.toml").write_text(
        'title = "two"\nscenario = "paper-example"\n[[vary]]\nname = "end"\nkind = "grid"\n'
        'values = [1.0, 2.0]\npath = "run.end"\n[metrics]\nsteps = "steps"\n'
    )
    made("run", *_RUN, "--out", "t.mcap")
    made("run", "auv-acoustic", "--until", "60", "--out", "linked.mcap")
    made("run", "auv-acoustic", "--until", "60", "--set", "run.seed=2", "--out", "other.mcap")
    made("link", "record", "linked.mcap", "--link", "uplink", "--out", "link.csv")
    made("design", "paper", "--save", "design.json")
    made("fmu", "build", "paper", "--out", "plant.fmu")
    made("ssp", "export", "paper-example", "--out", "scenario.ssp")
    made("study", "run", "study.toml", "--out", "study")
    content = (folder / "t.mcap").read_bytes()
    (folder / "cut.mcap.partial").write_bytes(content[: len(content) * 4 // 5])
