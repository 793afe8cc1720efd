"""Check the messages of links against what was sent, declared and counted, as they pass by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.checks.results import CheckResult, check_result
from cosim.trace.reader import Table
from cosim.trace.rows.layout import output_topic
from cosim.trace.tables.topic_info import TopicInfo

Integers = NDArray[np.int64]
_LATEST = 2**16
"""Messages of a link that are put in order of their numbers; a message is not later than that."""


class Link:
    """The checks of one link, fed with its messages in file order.

    Parameters
    ----------
    name : of the link.
    declared : the link as `cosim.run` describes it, and its order.
    figures : its figures in `cosim.result`; empty without a result.
    senders : the sender of each value, None for what is no output in the trace.
    """

    def __init__(
        self,
        name: str,
        declared: Mapping[str, Any],
        figures: Mapping[str, str],
        senders: Mapping[str, tuple[Sender, str] | None],
    ) -> None:
        self.name, self._declared, self._figures = name, declared, figures
        self._senders = senders
        # a delay that conditions change holds for some messages only
        keys = ("playout_ns",) if declared.get("adjustable") else ("delay_ns", "playout_ns")
        stated = (declared.get(key, 0) for key in keys)
        self._least = max((each for each in stated if isinstance(each, int)), default=0)
        self._early: list[str] = []
        self._back: list[str] = []
        self._before: list[str] = []
        self._values: dict[tuple[str, str], str] = {
            (column, ""): f"{column} is no output in this trace"
            for column, sender in senders.items()
            if sender is None
        }
        self._waiting: Table | None = None
        self._last: int | None = None
        self._sent = np.zeros((2, 0), np.int64)
        self._fates = Fates(2 if declared.get("duplicate") else 1)
        self._counts = {"delivered": 0, "dropped": 0}

    def add(self, delivered: Table | None, dropped: Table | None) -> None:
        """Take the next messages."""
        if dropped is not None:
            self._counts["dropped"] += len(dropped)
            self._fates.add(dropped.sequence)
        if delivered is None or not len(delivered):
            return
        self._counts["delivered"] += len(delivered)
        self._fates.add(delivered.sequence)
        self._check_delays(delivered)
        self._check_sequence(delivered)
        self._waiting = delivered.after(self._waiting)

    @property
    def earliest_ns(self) -> int | None:
        """Instant of sending of the earliest message whose values are still to be compared."""
        return None if self._waiting is None else int(self._waiting.publish_time_ns.min())

    def compare(self, *, everything: bool) -> None:
        """Compare the values of messages whose senders have rows beyond their sending."""
        waiting = self._waiting
        if waiting is None:
            return
        ready = np.ones(len(waiting), np.bool_)
        if not everything:
            for sender in {id(s[0]): s[0] for s in self._senders.values() if s}.values():
                ready &= waiting.publish_time_ns < sender.last_ns
        if ready.any():
            self._compare(waiting if ready.all() else waiting.part(ready))
        self._waiting = None if ready.all() else waiting.part(~ready)

    def problems(self) -> dict[str, list[str]]:
        """Return the problems by the name of the check, after the last message."""
        return {
            "link delays": self._early,
            "link sequence": self._back + self._before,
            "link fates": self._fates.problems,
            "link values": list(self._values.values()),
            "link counts": list(self._check_figures()),
        }

    def _check_delays(self, delivered: Table) -> None:
        transit = delivered.log_time_ns - delivered.publish_time_ns
        if not self._early and (transit < self._least).any():
            i = int(np.argmax(transit < self._least))
            self._early.append(
                f"message {delivered.sequence[i]} took {transit[i]} ns, "
                f"the link's delay or play-out is {self._least} ns"
            )

    def _check_sequence(self, delivered: Table) -> None:
        """Check that numbers grow in order of delivery, unless the order is as-arrived."""
        numbers, sent = delivered.sequence, delivered.publish_time_ns
        if self._declared.get("order") in ("newest-wins", "fifo") and not self._back:
            # of two copies, newest-wins drops the later one, fifo delivers both
            again = self._declared.get("order") == "fifo" and self._declared.get("duplicate")
            least = 0 if again else 1
            known = numbers if self._last is None else np.append(self._last, numbers)
            back = np.flatnonzero(np.diff(known) < least)
            if back.size:
                i = int(back[0])
                self._back.append(f"message {known[i + 1]} was delivered after {known[i]}")
        self._last = int(numbers[-1])
        both = np.concatenate([self._sent, [numbers, sent]], axis=1)
        both = both[:, np.argsort(both[0], kind="stable")]
        if not self._before and (np.diff(both[1]) < 0).any():
            self._before.append("a message was sent before one with a lower number")
        self._sent = both[:, -_LATEST:]

    def _compare(self, delivered: Table) -> None:
        """Check that every value is the sender's at the instant of sending, quantized."""
        step = self._declared.get("quantization", 0.0)
        for name, values in delivered.columns.items():
            found = self._senders.get(name)
            if found is None:
                continue
            sender, variable = found
            # sample and hold, in file order: rows out of order are another check's finding
            rows = sender.rows(delivered.publish_time_ns)
            there = rows >= 0
            if not there.all():
                i = int(np.argmin(there))
                self._values.setdefault(
                    (name, "early"),
                    f"{name}: message {delivered.sequence[i]} was sent before the sender's rows",
                )
            expected = sender.columns[variable][rows[there]]
            if isinstance(step, int | float) and step and expected.dtype.kind == "f":
                expected = np.rint(expected / step) * step
            got = values[there]
            differs = got != expected
            if got.dtype.kind == "f":
                differs &= ~(np.isnan(got) & np.isnan(expected))
            if differs.any():
                i = int(np.argmax(differs))
                number = delivered.sequence[there][i]
                self._values.setdefault(
                    (name, "other"),
                    f"{name}: message {number} has {got[i]!r}, sent was {expected[i]!r}",
                )

    def _check_figures(self) -> Iterator[str]:
        stated = {key: int(v) for key, v in self._figures.items() if v.isdecimal()}
        if not {"sent", "delivered", "dropped", "in_flight"} <= set(stated):
            if sum(self._counts.values()):  # a run of no steps has none
                yield "the result has no figures of it"
            return
        for what, count in self._counts.items():
            if count != stated[what]:
                yield f"{count} messages {what}, the result says {stated[what]}"
        total = stated["delivered"] + stated["dropped"] + stated["in_flight"]
        if stated["sent"] + stated.get("duplicated", 0) != total:
            yield f"{stated['sent']} messages sent, but {total} delivered, dropped or in flight"
        missing = stated["sent"] - self._fates.below(stated["sent"])
        copies = bool(self._declared.get("duplicate"))  # a copy may be in flight, its message not
        if missing > stated["in_flight"] or (missing < stated["in_flight"] and not copies):
            yield f"{missing} messages in flight, the result says {stated['in_flight']}"
        if self._fates.last >= stated["sent"]:
            yield (
                f"there is message {self._fates.last}, the result says {stated['sent']} were sent"
            )


class Sender:
    """The rows of a component that messages still to come may carry."""

    def __init__(self) -> None:
        self.columns: dict[str, NDArray[Any]] = {}
        self._times = np.zeros(0, np.int64)

    @property
    def last_ns(self) -> int:
        """Instant of the last row [ns]; -1 without."""
        return int(self._times[-1]) if self._times.size else -1

    def add(self, table: Table) -> None:
        """Take the next rows."""
        self._times = np.concatenate([self._times, table.log_time_ns])
        for name, known in self.columns.items():
            values = table.columns[name]
            self.columns[name] = np.concatenate([known, values]) if known.size else values

    def forget(self, before_ns: int) -> None:
        """Forget the rows before the one in force at an instant [ns]."""
        first = max(int(np.searchsorted(self._times, before_ns, "right")) - 1, 0)
        self._times = self._times[first:].copy()
        for name, values in self.columns.items():
            self.columns[name] = values[first:].copy()

    def rows(self, at_ns: Integers) -> Integers:
        """Return the number of the row in force at each instant; -1 before the first."""
        return np.searchsorted(self._times, at_ns, "right") - 1


class Fates:
    """The numbers of messages delivered or dropped: each as often as a link may deliver it.

    Numbers below the first that is missing are only counted, so that memory stays small.
    """

    def __init__(self, most: int) -> None:
        self.problems: list[str] = []
        self.last = -1
        self._most = most
        self._first = 0
        self._beyond = np.zeros(0, np.int64)
        self._again = np.zeros(0, np.int64)

    def add(self, numbers: Integers) -> None:
        """Take the numbers of further messages."""
        if not numbers.size:
            return
        self.last = max(self.last, int(numbers.max()))
        early = numbers[numbers < self._first]
        beyond = np.sort(np.concatenate([self._beyond, numbers[numbers >= self._first]]))
        single, again = _once(beyond)
        self._check(np.concatenate([early, again]))
        # up to the first gap, each number is known once; further copies are in `_again`
        run = int(np.argmin(np.append(single == np.arange(single.size) + self._first, False)))
        self._first += run
        self._beyond = single[run:]

    def _check(self, copies: Integers) -> None:
        """Take the numbers that came a further time."""
        if not copies.size:
            return
        self._again = np.sort(np.concatenate([self._again, copies]))
        found, counts = np.unique(self._again, return_counts=True)
        much = counts + 1 > self._most
        if much.any() and not self.problems:
            self.problems.append(
                f"message {found[much][0]} was delivered or dropped {counts[much][0] + 1} times"
            )

    def below(self, number: int) -> int:
        """Return how many numbers below one are known."""
        return min(self._first, number) + int((self._beyond < number).sum())


def _once(numbers: Integers) -> tuple[Integers, Integers]:
    """Return each of the sorted numbers once, and the further copies."""
    first = np.append(True, np.diff(numbers) != 0) if numbers.size else np.zeros(0, np.bool_)
    return numbers[first], numbers[~first]


_FINE = {
    "link delays": "no message was delivered before the link's delay or play-out was over",
    "link sequence": "sequence numbers follow the order of the link",
    "link fates": "every message was delivered, dropped or in flight, once",
    "link values": "values delivered are those sent",
    "link counts": "counts as in the result",
}


def checks_of_links(links: Sequence[Link], *, whole: bool) -> Iterator[CheckResult]:
    """Yield one check of each kind for all links together; counts only of a `whole` run."""
    if not links:
        yield CheckResult("links", "not checked", "the run has none")
        return
    names = ", ".join(link.name for link in links)
    found = {link.name: link.problems() for link in links}
    for check, fine in _FINE.items():
        if check != "link counts" or whole:
            problems = [f"{name}: {what}" for name, by in found.items() for what in by[check]]
            yield check_result(check, problems, f"{names}: {fine}")


def sender_of(
    name: str, topics: Mapping[str, TopicInfo], senders: dict[str, Sender]
) -> tuple[Sender, str] | None:
    """Return the sender and variable of `component.variable`; both names may have dots."""
    parts = name.split(".")
    for i in range(1, len(parts)):
        topic, variable = output_topic(".".join(parts[:i])), ".".join(parts[i:])
        info = topics.get(topic)
        if info is not None and any(signal.name == variable for signal in info.signals):
            sender = senders.setdefault(topic, Sender())
            sender.columns.setdefault(variable, np.zeros(0))
            return sender, variable
    return None
