"""The steps of a link as C, against the Python they are recorded from and against the model."""

from __future__ import annotations

import ctypes
import random
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any, NamedTuple

import link_model
import numpy as np
import pytest
from c_compiler import compile_c
from shared import sampled, share_of
from test_link_exact import Case, draw_case

from cosim.fmu import build_fmu
from cosim.fmu.export import component_module, host
from cosim.network import DELIVERED, REASONS, SUBSTITUTE, PacketLink, stepping

Arrival = stepping.Arrival
Message = stepping.Message
Receiver = stepping.Receiver
Reception = stepping.Reception
Rules = stepping.Rules
Sender = stepping.Sender
Sending = stepping.Sending
receive, rules_of, send = stepping.receive, stepping.rules_of, stepping.send

DRIVER = """
#include "link_step.h"

/* One message after the other, each from the state that the one before left, or, where
   `apart`, from a state of its own. */
__attribute__((visibility("default")))
void send_all(const LinkRules *rules, LinkSender *sender, const LinkMessage *message,
              LinkSending *found, int64_t count, int64_t apart) {
    for (int64_t i = 0; i < count; i++) {
        found[i] = link_send(&rules[apart * i], &sender[apart * i], &message[i]);
        sender[apart * i].free_ns = found[i].free_ns;
        sender[apart * i].behind_ns = found[i].behind_ns;
    }
}

__attribute__((visibility("default")))
void receive_all(const LinkRules *rules, LinkReceiver *receiver, const LinkArrival *arrival,
                 LinkReception *found, int64_t count, int64_t apart) {
    for (int64_t i = 0; i < count; i++) {
        LinkReception now = found[i] = link_receive(&rules[apart * i], &receiver[apart * i],
                                                    &arrival[i]);
        LinkReceiver then = {now.newest, now.sequence, now.origin_ns, now.dropped, now.delivered};
        receiver[apart * i] = then;
    }
}
"""


def of_a_link(source: str, folder: Path) -> bytes:
    """A source of the FMU of a packet link."""
    variables = component_module("link_channel.variables")
    link = PacketLink("link", sample_time_ns=1)
    spec = variables.packet_spec("Link", link, [variables.LinkSignal()])
    with zipfile.ZipFile(build_fmu(spec, folder, prebuilt=False)) as archive:
        return archive.read(f"sources/{source}")


class Core:
    """The C of the steps, compiled, over rows of int64."""

    def __init__(self, folder: Path) -> None:
        (folder / "link_step.h").write_bytes(of_a_link("link_step.h", folder))
        (folder / "driver.c").write_text(DRIVER)
        library = folder / f"steps{host().suffix}"
        compile_c("-O3", "-fPIC", "-shared", "driver.c", "-o", str(library), folder=folder)
        self.library = ctypes.CDLL(str(library))

    def each(self, function: str, rules: Any, state: Any, given: Any, result: type) -> list[Any]:
        """The results of one step after the other; of steps apart for as many rules as steps."""
        tables = [np.atleast_2d(np.array(table, np.int64)) for table in (rules, state, given)]
        count = len(given)
        found = np.zeros((count, len(result._fields)), np.int64)  # type: ignore[attr-defined]
        apart = int(tables[0].shape[0] > 1)
        self.library[function](
            *(ctypes.c_void_p(t.ctypes.data) for t in (*tables, found)),
            ctypes.c_int64(count),
            ctypes.c_int64(apart),
        )
        return [result(*row) for row in found.tolist()]


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Core:
    return Core(tmp_path_factory.mktemp("steps"))


def test_steps_in_c_are_the_python_bit_for_bit(core: Core) -> None:
    """20 000 random states and messages, also ones that no link comes to."""
    r = random.Random(1)  # noqa: S311 - cases, not secrets

    def time() -> int:
        return r.choice([0, 1, r.randint(0, 9), r.randint(0, 2**40)])

    def bit() -> int:
        return r.randint(0, 1)

    count = 20_000
    rules = [Rules(time(), time(), bit(), bit(), bit(), bit() * time()) for _ in range(count)]
    senders = [Sender(time(), time()) for _ in range(count)]
    messages = [Message(time(), time(), time(), bit(), bit(), time()) for _ in range(count)]
    expected = [send(*given) for given in zip(rules, senders, messages, strict=True)]
    assert core.each("send_all", rules, senders, messages, Sending) == expected
    small = range(-2, 4)
    receivers = [
        Receiver(r.choice(small), r.choice(small), time(), time(), time()) for _ in range(count)
    ]
    arrivals = [Arrival(r.choice(small), time(), r.randrange(7)) for _ in range(count)]
    wanted = [receive(*given) for given in zip(rules, receivers, arrivals, strict=True)]
    assert core.each("receive_all", rules, receivers, arrivals, Reception) == wanted
    assert {found.fate for found in expected} == {0, 1, 4, 6}
    assert {found.copy_fate for found in expected if found.copies} == {0, 6}
    assert {found.noticed for found in wanted} == {0, 1}


class Entry(NamedTuple):
    """A message or a copy at its arrival."""

    time: int
    number: int
    copy: int
    arrival: Arrival


def check_core(core: Core, number: int) -> None:
    """One random link by its C, and by the event-by-event model in integers and fractions."""
    case = draw_case(number)
    link, raw = case.link, link_model.raw_draws(case.link, case.end)
    for points in (None, case.points):
        model = link_model.run(link, case.end, raw, case.delay, points)
        rounded = link_model.LinkModel(link, case.end, points).up
        entries = core_entries(core, case, model, raw, rounded)
        for entry in entries:
            label = (entry.arrival.message, entry.copy)
            assert entry.time == model.entries[label].arrival
        assert len(entries) == len(model.entries)
        due = sorted(entry for entry in entries if entry.time <= case.end)
        found = core.each(
            "receive_all", rules_of(link), Receiver(), [e.arrival for e in due], Reception
        )
        fates = [
            ((e.arrival.message, e.copy), REASONS[f.status])
            for e, f in zip(due, found, strict=True)
        ]
        assert fates == model.received
        for entry, state, following in zip(due, found, [*due, None][1:], strict=True):
            if following is None or following.time > entry.time:
                note = model.at(entry.time)
                assert state.sequence == model.sequence(note.used)
                assert (state.origin_ns, state.dropped, state.delivered) == (
                    note.origin,
                    note.dropped,
                    note.delivered,
                )
        changed = {
            e.time: "delivered" if f.status == DELIVERED else "noticed"
            for e, f in zip(due, found, strict=True)
            if f.status == DELIVERED or f.noticed
        }
        assert changed == model.changes()
        assert all(f.sequence == SUBSTITUTE for f in found if f.noticed)


def core_entries(
    core: Core, case: Case, model: link_model.Outcome, raw: link_model.Raw, rounded: Any
) -> list[Entry]:
    """Every message sent by the C, and its copy, in order of sending."""
    count = sum(copy == 0 for _, copy in model.entries)
    sent = [model.entries[k, 0].sent for k in range(count)]
    messages = [
        Message(
            sent[k],
            case.delay(k, sent[k]),
            raw.jitter[k],
            raw.lost[k],
            raw.copied[k],
            raw.copy_jitter[k],
        )
        for k in range(count)
    ]
    entries: list[Entry] = []
    if not messages:
        return entries
    for k, found in enumerate(
        core.each("send_all", rules_of(case.link), Sender(), messages, Sending)
    ):
        arrival = Arrival(k, sent[k], found.fate)
        entries.append(Entry(rounded(found.arrival_ns), len(entries), 0, arrival))
        if found.copies:
            copy = Arrival(k, sent[k], found.copy_fate)
            entries.append(Entry(rounded(found.copy_arrival_ns), len(entries), 1, copy))
    return entries


@pytest.mark.parametrize("part", sampled(range(3), 1))
def test_steps_in_c_are_exact(core: Core, part: int) -> None:
    """1500 random links, as they are and on a grid, nanosecond by nanosecond."""
    for number in range(500 * part, 500 * (part + 1)):
        check_core(core, number)


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(10)))
def test_steps_in_c_are_exact_on_ten_thousand(core: Core, part: int) -> None:
    """10 000 random links, as they are and on a grid, nanosecond by nanosecond."""
    for number in range(1000 * part, 1000 * (part + 1)):
        check_core(core, number)


OTHER_STEPS = """
from cosim.fmu.compiled import library_source
from cosim.network import stepping
from cosim.network.stepping import Arrival, Rules

def loops(rules: Rules) -> Arrival:
    for _ in range(rules.frame_ns):
        pass
    return Arrival(0, 0, 0)

def divides(rules: Rules) -> Arrival:
    return Arrival(rules.frame_ns // 2, 0, 0)

def calls(rules: Rules) -> Arrival:
    return Arrival(abs(rules.frame_ns), 0, 0)

for stepping.send in (loops, divides, calls):
    try:
        print(library_source("kernel"))
    except TypeError as error:
        print(error)
"""


def test_what_has_no_c_is_refused(tmp_path: Path) -> None:
    """Python that might mean something else in C is not translated, and there is no kernel."""
    script = tmp_path / "other_steps.py"  # their source is read from a file
    script.write_text(OTHER_STEPS)
    done = subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, str(script)], capture_output=True, text=True, check=True
    )
    refused = "a step of a link has no C for: "
    statements = done.stdout.split(refused)
    assert statements[0] == ""
    begins = ("for _ in range(rules.frame_ns):", "rules.frame_ns // 2", "abs(rules.frame_ns)")
    for statement, begin in zip(statements[1:], begins, strict=True):
        assert statement.startswith(begin)
