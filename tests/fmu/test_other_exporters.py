"""What other exporters do that the standard does not foresee: it runs all the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from foreign.c_fmu import c_fmu, every, source_of, talker
from pythonfmu import FmuBuilder

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuSlave, describe_fmu

_SCRIPT = """
from pythonfmu import *
from pythonfmu.enums import Fmi2Status

class Percent(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.x, self.n, self.s = 1.0, 0, "a"
        self.register_variable(Real("x", causality=Fmi2Causality.output))
        self.register_variable(Integer("n", causality=Fmi2Causality.output))
        self.register_variable(String("s", causality=Fmi2Causality.parameter,
            variability=Fmi2Variability.tunable, start="a"))

    def do_step(self, time, step):
        self.log("100 %s %d %n %s%s", Fmi2Status.ok, "logAll")
        self.x += step
        self.n += 1
        return self.n < 3
"""


class Log:
    """Collects the messages of a slave."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def __call__(self, level: str, message: str, category: str) -> None:
        self.lines.append((level, message, category))


def test_plain_pythonfmu_slave_runs(tmp_path: Path) -> None:
    """An Integer without variability, a per cent sign in a message; False is a failed step."""
    script = tmp_path / "percent.py"
    script.write_text(_SCRIPT)
    FmuBuilder.build_FMU(script, dest=tmp_path)
    described = describe_fmu(tmp_path / "Percent.fmu")
    assert described.ports["n"].variability == "discrete"
    (broken,) = described.departures
    assert broken.endswith("n: a continuous variable of type Integer (V05, not-continuous)")
    log = Log()
    with FmuSlave(described, "it", log) as slave:
        slave.initialise({"s": "b"}, 0.0, 1.0)
        slave.step(0.0, 0.25)
        slave.step(0.25, 0.25)
        assert slave.read(["x", "n", "s"]) == {"x": 1.5, "n": 2, "s": "b"}
        slave.write({"s": "c"})
        assert slave.read(["s"]) == {"s": "c"}
        with pytest.raises(ComponentError, match=r"step from t = 0\.5 s returned fmi2Discard"):
            slave.step(0.5, 0.25)
        assert not slave.asked_to_end()
    departure, *messages = log.lines
    assert departure == ("warning", f"breaks the standard: {broken}", "")
    assert messages == [("info", "100 %s %d %n %s%s", "logAll")] * 3


def test_messages_without_environment_are_found_by_instance_name(tmp_path: Path) -> None:
    """Some slaves do not pass the environment to the logger."""
    text = source_of("talker_fmi2.c")
    given = "(m)->calls->componentEnvironment, (m)->name"
    assert given in text
    text = text.replace(given, "(m), (m)->name")
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path, text=text))
    logs = Log(), Log()
    with FmuSlave(described, "one", logs[0]), FmuSlave(described, "two", logs[1]):
        pass
    for name, log in zip(("one", "two"), logs, strict=True):
        assert log.lines == [
            ("info", f"{{talker}} 1 {name} URI 1", "logMade"),
            ("info", "freed", "logMade"),
        ]


def test_texts_that_are_none_are_read_all_the_same(tmp_path: Path) -> None:
    """NULL for an empty text, and bytes that are not UTF-8."""
    given = "values[k++] = AT(m, String, vr[i] % 10, j, STRING);"
    text = source_of("every_fmi3.c")
    assert given in text
    odd = '(void)m, values[k++] = vr[i] == 111 ? NULL : "a\\xff";'
    described = describe_fmu(
        c_fmu("every_fmi3.c", every(), tmp_path, text=text.replace(given, odd))
    )
    with FmuSlave(described, "it", Log()) as slave:
        slave.initialise({}, 0.0, 1.0)
        assert slave.read(["String.out", "String.row"]) == {
            "String.out": "",
            "String.row": ["a\ufffd", "a\ufffd"],
        }


@pytest.mark.parametrize(
    ("old", "new", "harmless"),
    [
        ('<Real start="0"/>', "<Real/>", True),
        ('<Real start="0"/>', '<Real start="0" unit="furlong"/>', True),
        ('name="y"', 'name="u"', False),
        ('<Real start="0"/>', '<Real start="zero"/>', False),
        ('causality="parameter" variability="fixed"', 'causality="parameter"', False),
    ],
)
def test_description_that_departs_from_the_standard(
    tmp_path: Path, old: str, new: str, *, harmless: bool
) -> None:
    """Harmless departures are logged; those with an unknown meaning are refused."""
    text = talker()
    assert old in text
    path = c_fmu("talker_fmi2.c", text.replace(old, new), tmp_path)
    if not harmless:
        with pytest.raises(InputError, match="not a valid FMU"):
            describe_fmu(path)
        return
    described = describe_fmu(path)
    assert len(described.departures) == 1
    assert described.ports["y"].feedthrough


def test_output_missing_in_model_structure_has_feedthrough(tmp_path: Path) -> None:
    """Undeclared dependencies mean all inputs."""
    text = talker().replace('<Outputs><Unknown index="2"/>', "<Outputs>")
    described = describe_fmu(c_fmu("talker_fmi2.c", text, tmp_path))
    assert described.ports["y"].feedthrough


def test_starts_of_what_is_computed_are_the_fmus_to_take(tmp_path: Path) -> None:
    """An output of the standard's default, calculated, has no start that could be given."""
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path))
    nothing: Any = Log()
    with FmuSlave(described, "it", nothing) as slave:
        with pytest.raises(InputError, match="y cannot be set before the initialisation") as caught:
            slave.initialise({"y": 1.0}, 0.0, 1.0)
        assert caught.value.got == "continuous output: never"
