"""What a run must show for every fault, in every call of FMI where it can happen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hostile.hostile_fmu import CALLS, FAULTS

VERSIONS = ("2.0", "3.0")
RUN_CALLS = CALLS[: CALLS.index("free") + 1]
"""Calls of every run; the others are calls of `cosim fmu check --run`."""
_LOOP = ("set", "get", "step")

CRASHES = {
    "segfault": "SIGSEGV",
    "abort": "SIGABRT",
    "kill": "SIGKILL",
    "exit-0": "exit",
    "exit-3": "exit.*3",
    "stack-overflow": "SIGSEGV",
    "double-free": "SIGABRT",
}
"""Faults that end the process, and what an error says of them (a regular expression)."""
HANGS = ("hang", "hang-deaf")
_LEAKS = ("leak", "leak-slowly")
_NOT_FINITE = {"not-a-number": "nan|not a number", "infinite": "inf"}
_NUMBERS = ("not-a-number", "infinite", "grow", "huge-constant")
_ALTERED = {
    "intrude": r"complete.*changed by a component",
    # whose call it was may be seen later only
    **dict.fromkeys(("garbage", "close-all"), r"closed its connection|what is no message"),
}
"""Faults that reach for what belongs to the program, and what it says of them."""
_STATUSES = {
    "negative": "-1",
    "discard": "Discard",
    "error": "Error",
    "fatal": "Fatal",
    "pending": "Pending|status 5",  # FMI 3 knows no such status
    "unknown": "77",
    "return-early": "Discard|early",
}
_OF_STEPS = ("pending", "return-early", "end", "leak-slowly")
_NO_HARM = (
    *("sleep", "flood-stdout", "flood-stderr", "print", "rounding", "flush-to-zero", "signals"),
    *("thread", "close-output", "child", "change-folder", "delete-resources"),
    *("delete-folder", "surroundings"),
    *("daemon", "trace-me", "truncate"),
)
"""The run goes on, as if nothing had happened. What a thread writes after the end may crash."""
_ONLY_IN = {
    **dict.fromkeys(_NUMBERS, ("get", "step")),
    **dict.fromkeys(_OF_STEPS, ("step",)),
    "intrude": _LOOP,  # what is written into rows before they are complete is written over
}
"""Calls in which a fault makes sense, if it does not in all."""
_WORDS = {
    "load": "load",
    "instantiate": "instantiat",
    "setup": "set(ting)? ?up",
    "enter": "initiali[sz]ation",
    "exit": "initiali[sz]ation",
    "set": "set",
    "get": "get",
    "step": "step",
    "terminate": "terminat",
    "free": "free",
    "reset": "reset",
    "state": "state",
}


@dataclass(frozen=True)
class Row:
    """A fault in a call, of an FMU of one version of FMI."""

    fault: str
    call: str
    version: str

    @property
    def name(self) -> str:
        """As a test is called."""
        return f"{self.fault}-in-{self.call}-{self.version}"


@dataclass(frozen=True)
class Expectation:
    """What the command must show.

    Attributes
    ----------
    codes : exit codes that are right.
    statuses : of the outcome in the trace; empty: any.
    words : regular expressions, all of them found in what is printed.
    whole : the run goes on to its end.
    """

    codes: tuple[int, ...]
    statuses: tuple[str, ...]
    words: tuple[str, ...] = ()
    whole: bool = False


def rows() -> Iterator[Row]:
    """Every fault in every call where it makes sense."""
    for fault in FAULTS[1:]:
        for call in CALLS:
            for version in VERSIONS:
                row = Row(fault, call, version)
                if _makes_sense(row):
                    yield row


def _makes_sense(row: Row) -> bool:
    fault, call = row.fault, row.call
    if call == "setup" and row.version == "3.0":
        return False  # FMI 3.0 has no such function
    if call not in RUN_CALLS:
        return fault in CRASHES or fault == "hang"
    if fault in _ONLY_IN:
        return call in _ONLY_IN[fault]
    if fault in _STATUSES or fault == "warning":
        # a constructor and fmiNFreeInstance return nothing, and an instance is there or is not
        return call not in ("load", "free") and (
            call != "instantiate" or fault in ("discard", "error", "fatal")
        )
    return True


def expectation(row: Row) -> Expectation:
    """What must be shown.

    ================================== ========== ==============================================
    fault                              exit code  what is printed
    ================================== ========== ==============================================
    the process ends (exit 0 as well)  4          component, call, time in the loop, the cause
    a call does not end                4          component, call, time in the loop, the limit
    memory beyond the limit            4          component, call, time in the loop, the limit
    a status beyond warning            4          component, call, time in the loop, the status
    the same in terminate              0          a warning, since the run is complete
    NaN, infinity at once              4          component, variable, time
    growing beyond all numbers         0          diverged: component, variable, time
    a huge constant                    0          nothing: the run is finished
    asks for the end                   0          stopped, and who asked
    writes to rows of others           4          that complete rows were changed
    breaks the connection              4          what is wrong with it
    anything else                      0          nothing: the run is finished
    the same in reset, get state       1          `cosim fmu check`: the call and the cause
    ================================== ========== ==============================================
    """
    fault, call = row.fault, row.call
    place = ("'h'", _WORDS[call], *([r"t = 1(\.0*)? s"] if call in _LOOP else []))
    if call not in RUN_CALLS:
        words = (_WORDS[call], CRASHES.get(fault, "no answer within"))
        return Expectation((1,), (), words)
    failed = _failure(row, place)
    if failed is not None:
        # after its last row the run itself is finished
        over = call in ("terminate", "free")
        return Expectation((4,), ("failed", "finished") if over else ("failed",), failed)
    if fault == "grow":
        return Expectation((0,), ("diverged",), (r"h\.x|'h'",))
    if fault == "end":
        return Expectation((0,), ("stopped",), ("'h'", "end"))
    codes = (0, 4) if fault == "thread" else (0,)
    return Expectation(codes, ("finished", "failed")[: len(codes)], whole=True)


def _failure(row: Row, place: tuple[str, ...]) -> tuple[str, ...] | None:
    """What is printed of a run that fails; None if it does not."""
    fault, call = row.fault, row.call
    if fault in CRASHES:
        return (*place, CRASHES[fault])
    if fault in HANGS:
        return (*place, "limit")
    if fault in _LEAKS:
        return ("'h'", _WORDS[call], "memory", "limit")
    if fault in _NOT_FINITE:
        return (r"\bh\b", r"\bx\b", _NOT_FINITE[fault], r"t = 1(\.0\d*)? s")
    if fault in _STATUSES and call != "terminate":
        return (*place, "refuses" if call == "instantiate" else _STATUSES[fault])
    return (_ALTERED[fault],) if fault in _ALTERED else None


def at(row: Row) -> float:
    """The time from which on the fault happens [s]: in the middle of the run, if it can be."""
    if row.fault == "grow":
        return 0.25
    return 1.0 if row.call in _LOOP else 0.0
