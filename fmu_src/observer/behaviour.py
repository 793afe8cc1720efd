"""Behaviour of Observer and OutputFeedback, with the equations of `cosim.models.observer`.

A delay equation whose held inputs are innovations and the control that acts. It decides at
communication points only: what arrives there is used from there on, and what is commanded follows
from the estimate there, so that no output depends on an input without delay.
"""

from __future__ import annotations

import builtins
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from cosim.fmu.export import DelayPlant
from cosim.models import (
    EstimateLine,
    acting_control,
    clamped_command,
    feedback_command,
    greatest_share,
    innovation,
    linear_derivatives,
    share_of_age,
    watch,
)

_MOST = 2**31 - 1  # greatest Integer of FMI


class Measured(NamedTuple):
    """A measurement: the names of its values, and of what belongs to it."""

    name: str
    values: list[str]

    @property
    def innovations(self) -> list[str]:
        """Names of the innovations, one for each value."""
        return [f"innovation.{value}" for value in self.values]


class Observer(DelayPlant):
    """The estimate, ages and assumptions; with commands also their sampling and play-out."""

    def __init__(self, constants: dict[str, Any]) -> None:
        n, m = constants["size"]
        self.measured = [
            Measured(name, [f"{name}[{i}]" for i in range(1, rows + 1)])
            for name, rows in constants["measurements"]
        ]
        self.commands: list[str] = constants["commands"]
        self.delays = constants["delays"]
        self.states = [f"estimate[{i}]" for i in range(1, n + 1)]
        word = "applied" if self.commands else "u"
        self.acting = [f"{word}[{j}]" for j in range(1, m + 1)]
        self.innovations = [name for one in self.measured for name in one.innovations]
        self.inputs = [*self.acting, *self.innovations]
        self.uses = ["age", "envelope", *(["saturation"] if self.commands else [])]
        self._bounded: list[int] = constants["envelope"]
        self._with_limits: bool = constants["with_limits"]
        self._mapped: bool = constants["mapped"]
        self.trimmed: bool = constants["trimmed"]

    # ---- equations

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Bounds that shares are taken of must be positive."""
        bounds = [f"age.{one.name}" for one in self.measured]
        bounds += [f"envelope[{i}]" for i in self._bounded]
        bounds += [f"limit.{name}" for name in self.commands] if self._with_limits else []
        return [(v[name], f"{name} must be positive") for name in bounds]

    def constants(self, v: Any) -> Any:
        """Return all matrices by letter; L of all measurements is C of the delay equation."""

        def entries(letter: str, rows: int, columns: int) -> list[list[Any]]:
            return [[v[f"{letter}[{i + 1},{j + 1}]"] for j in range(columns)] for i in range(rows)]

        n, m, r = len(self.states), len(self.acting), len(self.commands)
        late = range(1, len(self.delays) + 1)
        found = {f"A{i}": entries(f"A{i}", n, n) for i in late}
        found |= {"A": entries("A", n, n), "B": entries("B", n, m)}
        injections = [entries(f"L.{one.name}", n, len(one.values)) for one in self.measured]
        found["C"] = [
            [x for rows in parts for x in rows] for parts in zip(*injections, strict=True)
        ]
        seen = {one.name: entries(f"C.{one.name}", len(one.values), n) for one in self.measured}
        if not self.commands:
            return found, seen, None, None, None
        K = entries("K", m, n)
        if not self._mapped:
            return found, seen, K, None, None
        return found, seen, K, entries("thrust_map", r, m), entries("allocation", m, r)

    def rates(
        self, t: Any, x: Sequence[Any], late: list[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Compute xh' from the control that acts and the held innovations."""
        m = len(self.acting)
        return linear_derivatives(t, x, late, u[:m], u[m:], c[0], None, ns)

    def compared(self, v: Any, stored: Sequence[Any], c: Any) -> list[Any]:
        """Compute the innovations of all measurements in `v` against one stored estimate."""
        found = []
        for one in self.measured:
            y = [v[name] for name in one.values]
            if self.trimmed:
                y = [value - v[f"trim.{name}"] for value, name in zip(y, one.values, strict=True)]
            found += innovation(y, c[1][one.name], stored)
        return found

    def decided(self, v: Any, x: Sequence[Any], c: Any, ns: Any) -> list[Any]:
        """Compute what follows from the estimate x.

        The commands and the control that they give, the same of the safe values, and the use of
        the envelope and of the limits.
        """
        bounds = [v[f"envelope[{i}]"] for i in self._bounded]
        envelope = greatest_share([x[i - 1] for i in self._bounded], bounds, ns)
        if not self.commands:
            return [envelope]
        K, thrust_map, allocation = c[2:]
        reference = [v[f"reference[{i}]"] for i in range(1, len(x) + 1)]
        trim = [v[f"trim.{name}"] for name in self.commands] if self.trimmed else []
        free = feedback_command(K, x, reference, thrust_map)
        if trim:
            free = [a + b for a, b in zip(free, trim, strict=True)]
        limits = [v[f"limit.{name}"] for name in self.commands] if self._with_limits else []
        found: list[Any] = []
        for values in (free, [v[f"safe.{name}"] for name in self.commands]):
            commands = clamped_command(values, limits, ns) if limits else values
            found += [*commands, *acting_control(commands, trim, allocation)]
        return [*found, envelope, greatest_share(free if limits else [], limits, ns)]

    # ---- a run

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Start with the initial estimate, without a measurement, and with commands at the trim."""
        started = [*self.commands, *self.acting] if self.commands else []
        v.update(dict.fromkeys([*self.innovations, *started], 0.0))
        if self.trimmed and self.commands:
            v.update(zip(started, self._at_trim(v), strict=True))
        super().initialise(v, start)
        initial = [v[f"initial.{name}"] for name in self.states]
        memory = max(v[f"age.{one.name}"] for one in self.measured)
        delays = [v[name] for name in self.delays]
        self._line = EstimateLine(initial, delays, v["solver.step"], start, memory)
        self._start, self._samples = start, 0
        # the last stamp seen, the one in use, and whether there is one
        self._stamps = [[v[f"stamp.{one.name}"], start, 0] for one in self.measured]
        # own commands on their way: the time of the estimate behind each, and its control
        self._ahead: list[list[float]] = []
        self._behind = start  # time of the estimate behind the control that acts
        self._notice: str | None = None
        for one in self.measured:
            v[f"message_age.{one.name}"] = 0.0
            v[f"ignored.{one.name}"] = 0
        for use in self.uses:
            v[f"present.{use}"] = v[f"assumption.{use}"] = 0.0
        watch(v, self.uses)
        if self.commands:
            v["watchdog"] = 0

    def _at_trim(self, v: dict[str, float]) -> list[float]:
        """Return the commands at the trim, limited as any, and the control that they give."""
        trim = {f"safe.{name}": v[f"trim.{name}"] for name in self.commands}
        found = self.decided({**v, **trim}, [0.0] * len(self.states), self.constants(v), builtins)
        both = len(self.commands) + len(self.acting)
        return found[both : 2 * both]

    def advance(self, v: dict[str, float], end: float) -> None:
        """Use what has arrived, integrate, and command what follows from the estimate at `end`.

        Raises
        ------
        ValueError : a stamp in the future.
        ArithmeticError : a value is no longer finite.
        """
        for one, state in zip(self.measured, self._stamps, strict=True):
            self._receive(v, one, state)
        near = 16.0 * math.ulp(max(1.0, abs(end)))
        later, oldest = v["command.delay"] if self.commands else 0.0, 0.0
        while self._ahead and self._ahead[0][0] + later < end - near:
            instant = self._ahead[0][0] + later
            if instant > self._line.time:
                super().advance(v, instant)
            oldest = max(oldest, instant - self._behind)
            self._act(v)
        super().advance(v, end)
        late = self._ages(v, end, max(oldest, end - self._behind))
        found = self.decided(v, self._line.x, self._constants, builtins)
        if not all(map(math.isfinite, [v["present.age"], *found])):
            raise ArithmeticError(f"a command or the use of an assumption at {end!r} s overflows")
        if self.commands:
            self._command(v, end, late, found)
            while self._ahead and self._ahead[0][0] + later <= end + near:
                self._act(v)
        else:
            v["present.envelope"] = found[0]
        watch(v, self.uses)

    def _receive(self, v: dict[str, float], one: Measured, state: list[float]) -> None:
        """Take a packet with a new stamp: its innovation is held from now on."""
        stamp, now, oldest = v[f"stamp.{one.name}"], self._line.time, v[f"age.{one.name}"]
        if stamp == state[0]:
            return
        near = 1e-9 * max(1.0, abs(now))  # as the times of a step may drift
        if stamp > now + near:
            raise ValueError(f"stamp.{one.name} is {stamp!r} s, in the future of t = {now!r} s")
        earlier = state[1] if state[2] else state[0]
        state[0] = stamp
        if stamp <= earlier or now - stamp > oldest + near:
            v[f"ignored.{one.name}"] = min(v[f"ignored.{one.name}"] + 1, _MOST)
            return
        stored = self._line.at(min(max(stamp, now - oldest), now))
        found = self.compared(v, stored, self._constants)
        own = [self.innovations.index(name) for name in one.innovations]
        for i in own:
            if not math.isfinite(found[i]):
                raise ArithmeticError(f"{self.innovations[i]} is not finite")
        v.update((self.innovations[i], found[i]) for i in own)
        state[1:] = [stamp, 1]

    def _act(self, v: dict[str, float]) -> None:
        self._behind, *control = self._ahead.pop(0)
        v.update(zip(self.acting, control, strict=True))

    def _ages(self, v: dict[str, float], end: float, oldest: float) -> Measured | None:
        """Write ages and their use; return the first measurement that is too old.

        `oldest` : the greatest age of an estimate behind the control that acted in this step.
        """
        greatest, late = 0.0, None
        for one, state in zip(self.measured, self._stamps, strict=True):
            age = end - state[1]
            share, beyond = share_of_age(age, v[f"age.{one.name}"], end)
            greatest = max(greatest, share)
            if beyond and late is None:
                late = one
            v[f"message_age.{one.name}"] = age
        if self.commands and v["age.command"] > 0.0:
            share, _ = share_of_age(oldest, v["age.command"], end)
            greatest = max(greatest, share)
        v["present.age"] = greatest
        return late

    def _command(
        self, v: dict[str, float], end: float, late: Measured | None, found: list[float]
    ) -> None:
        """Command K xh at sample instants, and the safe values while a measurement is too old."""
        period, due = v["sample_time"], True
        if period > 0.0:
            # an instant that is after `end` only by rounding belongs to this point
            near = max(1e-9 * max(period, 1e-3), 16.0 * math.ulp(end))
            taken = math.floor((end + near - self._start) / period)
            due = taken > self._samples
            self._samples = max(taken, self._samples)
        if (late is not None) != v["watchdog"]:
            due = True
            v["watchdog"] = int(late is not None)
            self._notice = _notice_of(late, v, end)
        v["present.envelope"] = found[-2]
        if not due:
            return
        r, m = len(self.commands), len(self.acting)
        if late is None:
            v["present.saturation"] = found[-1]
        chosen = found[r + m : 2 * (r + m)] if late is not None else found[: r + m]
        v.update(zip(self.commands, chosen[:r], strict=True))
        self._ahead.append([end, *chosen[r:]])

    def notice(self) -> str | None:
        """Return, once, what the last step has to report."""
        text, self._notice = self._notice, None
        return text

    # ---- the whole state

    def snapshot(self) -> dict[str, Any]:
        """Return the whole state: estimates, stamps, clock, and commands on their way."""
        return {
            **super().snapshot(),
            "start": self._start,
            "samples": self._samples,
            "stamps": self._stamps,
            "ahead": self._ahead,
            "behind": self._behind,
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`; the parameters are restored with the variables."""
        super().restore(saved)
        self._start, self._samples = saved["start"], saved["samples"]
        self._behind = saved["behind"]
        self._stamps = [list(state) for state in saved["stamps"]]
        self._ahead = [list(one) for one in saved["ahead"]]


def _notice_of(late: Measured | None, v: dict[str, float], end: float) -> str:
    begin = f"watchdog at t = {end:.10g} s: "
    if late is None:
        return begin + "all ages are allowed again, commands follow the estimate"
    age, most = v[f"message_age.{late.name}"], v[f"age.{late.name}"]
    return begin + (
        f"{late.name} is {age:.10g} s old, age.{late.name} is {most:.10g} s: "
        "safe values are commanded"
    )
