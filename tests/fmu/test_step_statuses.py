"""Statuses that FMI does not know, discarded steps, steps that end early, pending steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from foreign.steered import VERSIONS, parameters, steered_fmu

from cosim.core import ComponentError
from cosim.fmu import FmuSlave, describe_fmu

if TYPE_CHECKING:
    from cosim.fmu import FmuDescription

Fmus = dict[str, "FmuDescription"]
STOP = 2.0


class Log:
    """Collects the messages of a slave."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str, str]] = []

    def __call__(self, level: str, message: str, category: str) -> None:
        self.lines.append((level, message, category))


@pytest.fixture(scope="module")
def steered(tmp_path_factory: pytest.TempPathFactory) -> Fmus:
    """The FMU that does as it is told, of each version."""
    folder = tmp_path_factory.mktemp("steered")
    return {version: describe_fmu(steered_fmu(folder, version)) for version in VERSIONS}


def run(slave: FmuSlave, given: dict[str, float]) -> None:
    """Go through all calls that may be refused, until one is."""
    slave.set_start(given)
    slave.enter_initialisation(0.0, STOP)
    slave.exit_initialisation()
    slave.step(0.0, 0.25)
    slave.read(["x"])
    slave.free(slave.snapshot())
    slave.reset()


@pytest.mark.parametrize("status", [-1, -(2**31), 77, 6])
@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("step", "step from t = 0 s"),
        ("get", "reading x"),
        ("set", "setting at, until"),
        ("enter", "entering the initialisation"),
        ("exit", "the initialisation"),
        ("save", "saving the state"),
        ("reset", "a reset"),
    ],
)
@pytest.mark.parametrize("version", VERSIONS)
def test_unknown_status_is_a_failure_and_is_named(
    steered: Fmus, version: str, what: str, words: str, status: int
) -> None:
    """Whatever call returns it; nothing but close is allowed then."""
    with FmuSlave(steered[version], "it", Log()) as slave:
        with pytest.raises(ComponentError) as caught:
            run(slave, parameters(what, status))
        assert caught.value.what == f"{words} returned status {status}, which FMI does not know"
        assert "component 'it' (steered.fmu)" in str(caught.value)
        with pytest.raises(ComponentError, match="is called after the end"):
            slave.step(0.0, 0.25)


@pytest.mark.parametrize("version", VERSIONS)
def test_unknown_status_of_terminate_is_logged(steered: Fmus, version: str) -> None:
    """The instance is freed all the same."""
    log = Log()
    with FmuSlave(steered[version], "it", log) as slave:
        slave.initialise(parameters("terminate", -1), 0.0, STOP)
    assert log.lines == [("warning", "terminating the slave: status -1", "")]
    assert slave.phase == "closed"


def test_pending_is_a_failure_of_fmi_2_only(steered: Fmus) -> None:
    """Steps in the background are not allowed; FMI 3.0 has no such status."""
    with FmuSlave(steered["2.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 5), 0.0, STOP)
        with pytest.raises(ComponentError, match="returned fmi2Pending") as caught:
            slave.step(0.0, 0.25)
        assert caught.value.hint == "steps that go on in the background are not supported"
    with FmuSlave(steered["3.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 5), 0.0, STOP)
        with pytest.raises(ComponentError, match="status 5, which FMI does not know"):
            slave.step(0.0, 0.25)


NOT_IN_IT = "computed until t = 1e+300 s as it says, which is not in the step"


@pytest.mark.parametrize(
    ("at", "until", "reason"),
    [
        (0.5, 0.6, "in the step from t = 0.5 s, computed until t = 0.6 s"),
        (0.5, 0.75, "in the step from t = 0.5 s"),
        (0.5, -1.0, "in the step from t = 0.5 s"),
        (1.75, 2.0, "in the step from t = 1.75 s"),
        (0.5, 1e300, f"in the step from t = 0.5 s, {NOT_IN_IT}"),
    ],
)
@pytest.mark.parametrize("version", VERSIONS)
def test_slave_ends_the_run(
    steered: Fmus, version: str, at: float, until: float, reason: str
) -> None:
    """By Discard or by terminateSimulation; the reason says until when it computed, if known."""
    status = 2 if version == "2.0" else 0
    wish = parameters("step", status, at, ends=1, until=until)
    with FmuSlave(steered[version], "it", Log()) as slave:
        slave.initialise(wish, 0.0, STOP)
        asked = []
        for k in range(round(at / 0.25) + 1):
            slave.step(k * 0.25, 0.25)
            asked.append(slave.asked_to_end())
        assert asked == [False] * (len(asked) - 1) + [True]
        assert (
            slave.early_end(at, at + 0.25, status) == f"component 'it' asked for the end {reason}"
        )
        assert slave.phase == "stepping"


def test_early_return_by_which_the_slave_ends_the_run_is_no_failure(steered: Fmus) -> None:
    """FMI 3.0: terminateSimulation comes first."""
    with FmuSlave(steered["3.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 0, ends=1, early=1, until=0.1), 0.0, STOP)
        slave.step(0.0, 0.25)
        assert slave.asked_to_end()


def test_early_return_is_a_failure(steered: Fmus) -> None:
    """It was not allowed; the message names the last successful time."""
    with FmuSlave(steered["3.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 0, 0.5, early=1, until=0.6), 0.0, STOP)
        slave.step(0.0, 0.5)
        with pytest.raises(ComponentError, match=r"step from t = 0\.5 s ended early") as caught:
            slave.step(0.5, 0.25)
        assert caught.value.got == "t = 0.6 s"
        assert not slave.asked_to_end()
        with pytest.raises(ComponentError, match="is called after the end"):
            slave.step(0.75, 0.25)


@pytest.mark.parametrize("until", [0.6, 0.75, -1.0])
def test_discarded_step_is_a_failure(steered: Fmus, until: float) -> None:
    """FMI 2.0: the slave does not ask for the end; the message names the last successful time."""
    with FmuSlave(steered["2.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 2, 0.5, until=until), 0.0, STOP)
        slave.step(0.0, 0.5)
        with pytest.raises(ComponentError) as caught:
            slave.step(0.5, 0.25)
        known = "" if until < 0 else f", having computed until t = {until:g} s"
        assert caught.value.what == f"step from t = 0.5 s returned fmi2Discard{known}"
        assert not slave.asked_to_end()


def test_discarded_step_of_fmi3_is_a_failure(steered: Fmus) -> None:
    """The state is that before the step: there is no last successful time."""
    with FmuSlave(steered["3.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 2, until=0.1, ends=1), 0.0, STOP)
        with pytest.raises(ComponentError) as caught:
            slave.step(0.0, 0.25)
        assert caught.value.what == "step from t = 0 s returned fmi3Discard"


@pytest.mark.parametrize(("stop", "fine"), [(2.0, True), (2.0000000001, True), (3.0, False)])
def test_discard_at_the_end_of_the_run_is_none(steered: Fmus, stop: float, *, fine: bool) -> None:
    """FMI 2.0: the slave has computed all that it was asked for, to the nanosecond."""
    with FmuSlave(steered["2.0"], "it", Log()) as slave:
        slave.initialise(parameters("step", 2, 1.75, until=2.0), 0.0, stop)
        slave.step(0.0, 1.75)
        if not fine:
            with pytest.raises(ComponentError, match="until t = 2 s"):
                slave.step(1.75, 0.25)
            return
        slave.step(1.75, 0.25)
        assert slave.asked_to_end()
