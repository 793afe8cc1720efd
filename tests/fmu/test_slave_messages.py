"""Log messages of foreign slaves, how they ask for the end, and how they fail."""

from __future__ import annotations

from pathlib import Path

import pytest
from foreign.c_fmu import c_fmu, every, talker

from cosim.core import ComponentError, InputError
from cosim.fmu import FmuDescription, FmuSlave, describe_fmu


class Log:
    """Collects the messages of a slave."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def __call__(self, level: str, message: str, category: str) -> None:
        self.lines.append((level, message, category))


@pytest.fixture(scope="module")
def fmi2(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 2.0 slave that says a lot."""
    return describe_fmu(c_fmu("talker_fmi2.c", talker(), tmp_path_factory.mktemp("talker")))


@pytest.fixture(scope="module")
def fmi3(tmp_path_factory: pytest.TempPathFactory) -> FmuDescription:
    """The FMI 3.0 slave."""
    return describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path_factory.mktemp("every")))


def test_messages_of_fmi2_are_formatted(fmi2: FmuDescription) -> None:
    """With arguments, names in place of references, levels and categories."""
    log = Log()
    with FmuSlave(fmi2, "one", log) as slave:
        slave.initialise({}, 0.0, 1.0)
        slave.step(0.0, 0.25)
    assert log.lines == [
        ("info", "{talker} 1 one URI 1", "logMade"),
        ("info", "step 0 from 0.00 s by 0.25, u and greeting # 50% 1", "logStep"),
        ("warning", "terminated", "logMade"),
        ("info", "freed", "logMade"),
    ]


def test_messages_go_to_the_log_of_their_own_instance(
    fmi2: FmuDescription, fmi3: FmuDescription
) -> None:
    """Several instances, also of one name, each with its own log; none after the end."""
    logs = [Log(), Log(), Log()]
    slaves = [
        FmuSlave(described, "same", log)
        for described, log in zip((fmi2, fmi2, fmi3), logs, strict=True)
    ]
    for slave in slaves:
        slave.initialise({}, 0.0, None)
    slaves[1].step(0.0, 0.5)
    for slave in slaves:
        slave.close()
        slave.close()
    steps = [sum("step" in message for _, message, _ in log.lines) for log in logs]
    assert steps == [0, 1, 0]
    made, (level, broken, _), *rest = logs[2].lines
    assert (level, broken.partition(":")[0]) == ("warning", "breaks the standard")
    assert "C06, clock-event-mode" in broken
    assert [made, *rest] == [
        ("info", "token {every}, resources end with '/', options 0 0 0", "made"),
        ("info", "from 0 to -1", ""),
        ("info", "terminated", "made"),
    ]


def test_log_categories_restrict_what_is_logged(fmi2: FmuDescription, fmi3: FmuDescription) -> None:
    """The FMU gets them; other messages are filtered here, except those of failures."""
    log = Log()
    with FmuSlave(fmi2, "it", log, categories=["logStep"]) as slave:
        slave.initialise({"mode": 3}, 0.0, 1.0)
        for k in range(3):
            slave.step(k / 4, 0.25)
        with pytest.raises(ComponentError):
            slave.step(0.75, 0.25)
    assert {category for _, _, category in log.lines} == {"logStep"}
    log = Log()
    with FmuSlave(fmi3, "it", log, categories=["made"]) as slave:
        slave.initialise({"fail_at": 0.0}, 0.0, 1.0)
        with pytest.raises(ComponentError):
            slave.step(0.0, 0.5)
    (_, broken, _), *others = [line for line in log.lines if line[2] != "made"]
    assert broken.startswith("breaks the standard")
    assert others == [("error", "it broke", "bad")]
    with pytest.raises(InputError, match="there is no log category 'mad'") as caught:
        FmuSlave(fmi3, "it", log, categories=["mad"])
    assert "did you mean made" in str(caught.value)


@pytest.mark.parametrize(("mode", "asks"), [(0, False), (1, True), (5, True)])
def test_slave_of_fmi2_asks_for_the_end(fmi2: FmuDescription, mode: int, *, asks: bool) -> None:
    """By Discard and the status Terminated; it is then terminated and freed."""
    log = Log()
    with FmuSlave(fmi2, "it", log) as slave:
        slave.initialise({"mode": mode}, 0.0, 1.0)
        asked = []
        for k in range(4):
            slave.step(k / 4, 0.25)
            asked.append(slave.asked_to_end())
    assert asked == [False, False, False, asks]
    assert ("warning", "terminated", "logMade") in log.lines


@pytest.mark.parametrize(
    ("mode", "status", "expected"),
    [(2, "Discard", None), (3, "Fatal", "lost"), (4, "Discard", "broke")],
)
def test_slave_of_fmi2_fails(
    fmi2: FmuDescription, mode: int, status: str, expected: str | None
) -> None:
    """By Discard without asking for the end, by an error, by Fatal: nothing is called then."""
    log = Log()
    with FmuSlave(fmi2, "it", log) as slave, FmuSlave(fmi2, "other", Log()) as other:
        slave.initialise({"mode": mode}, 0.0, 1.0)
        other.initialise({}, 0.0, 1.0)
        for k in range(3):
            slave.step(k / 4, 0.25)
        with pytest.raises(ComponentError) as caught:
            slave.step(0.75, 0.25)
        text = str(caught.value)
        assert (
            f"component 'it' (talker_fmi2.fmu): step from t = 0.75 s returned fmi2{status}" in text
        )
        assert expected is None or expected in str(caught.value.got)
        with pytest.raises(ComponentError, match="fmi2DoStep is called after the end"):
            slave.step(0.75, 0.25)
        if status == "Fatal":
            with pytest.raises(ComponentError, match="fmi2GetReal is called after the end"):
                other.read(["y"])
        else:
            assert other.read(["y"]) == {"y": 0.0}
    freed = ("info", "freed", "logMade")
    assert (freed in log.lines) == (status != "Fatal")
    assert "terminated" not in {message for _, message, _ in log.lines}


def test_slave_of_fmi3_asks_for_the_end(fmi3: FmuDescription) -> None:
    """By the flag of its step, at the address that a caller of fmi3DoStep is given."""
    with FmuSlave(fmi3, "it", Log()) as slave:
        slave.initialise({"end_at": 1.0}, 0.0, None)
        asked = []
        for k in range(4):
            slave.step(k / 4, 0.25)
            asked.append(slave.asked_to_end())
    assert asked == [False, False, False, True]


@pytest.mark.parametrize(("status", "word"), [(2, "Discard"), (3, "Error"), (4, "Fatal")])
def test_slave_of_fmi3_fails(fmi3: FmuDescription, status: int, word: str) -> None:
    """The error has its message; an unknown status is an error as well."""
    log = Log()
    with FmuSlave(fmi3, "it", log) as slave:
        slave.initialise({"fail_at": 0.5, "status": status}, 0.0, 1.0)
        slave.step(0.0, 0.5)
        with pytest.raises(ComponentError, match=f"from t = 0.5 s returned fmi3{word}") as caught:
            slave.step(0.5, 0.5)
        assert caught.value.got == "it broke"
    assert log.lines[-1][1] == "it broke"
    with FmuSlave(fmi3, "it", log) as slave:
        slave.initialise({"fail_at": 0.0, "status": 5}, 0.0, 1.0)
        with pytest.raises(ComponentError, match="from t = 0 s returned"):
            slave.step(0.0, 0.5)


def test_addresses_are_those_of_the_functions(
    fmi2: FmuDescription, fmi3: FmuDescription, tmp_path: Path
) -> None:
    """A compiled loop calls them; a missing function is reported."""
    for described, name in ((fmi2, "Real"), (fmi3, "Float64")):
        with FmuSlave(described, "it", Log()) as slave:
            found = {slave.address("get", name), slave.address("set", name), slave.address("step")}
            assert len(found) == 3
            assert min(found) > 0
            assert slave.component > 0
            assert slave.step_results % 8 == 0
    flags = 'canGetAndSetFMUstate="true"'
    described = describe_fmu(c_fmu("talker_fmi2.c", talker(flags=flags), tmp_path))
    with (
        FmuSlave(described, "it", Log()) as slave,
        pytest.raises(ComponentError, match="lacks a function") as caught,
    ):
        slave.snapshot()
    assert "fmi2GetFMUstate" in str(caught.value.got)
