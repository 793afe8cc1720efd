"""What threads of a process share: things that are made once, and settings of the process."""

from __future__ import annotations

import ast
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import flint
import numpy as np
import pytest
from threadpoolctl import threadpool_info

from cosim.core import InputError, once, one_blas_thread, say_once
from cosim.hinf.exact import ball_precision
from cosim.scenario import formula

THREADS = 8


def in_threads(work: Callable[[int], object]) -> None:
    begin = threading.Barrier(THREADS)

    def at_once(number: int) -> None:
        begin.wait(60)
        work(number)

    with ThreadPoolExecutor(THREADS) as pool:
        list(pool.map(at_once, range(THREADS)))


def test_a_thing_is_made_once_for_all_threads() -> None:
    """Who asks meanwhile waits; for other arguments it is made again, and after a failure."""
    calls: list[int] = []

    @once
    def make(number: int) -> object:
        calls.append(number)
        time.sleep(0.02)
        if len(calls) == 1:
            raise InputError("not yet")
        return object()

    with pytest.raises(InputError):
        make(1)
    found: list[object] = []
    in_threads(lambda number: found.append((number % 2, make(number % 2))))
    assert sorted(calls) == [0, 1, 1]
    assert len(set(found)) == 2


def test_notice_of_several_threads_is_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    """Standard error has it once."""
    in_threads(lambda _: say_once("said by several threads"))
    assert capsys.readouterr().err == "cosim: said by several threads\n"


def blas_threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_blas_has_one_thread_as_long_as_one_of_them_needs_it() -> None:
    """Contexts that overlap in any order: neither ends the other's, and the last one ends it."""
    np.linalg.inv(np.eye(3))
    before = blas_threads()
    first, second = one_blas_thread(), one_blas_thread()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert blas_threads() == {1}
    second.__exit__(None, None, None)
    assert blas_threads() == before


def test_the_precision_of_balls_is_that_of_the_thread_that_computes() -> None:
    """python-flint has one for all threads: it stays as set in the context, and as before after."""
    before = flint.ctx.prec
    wrong: list[int] = []

    def compute(number: int) -> None:
        for _ in range(20):
            with ball_precision(100 + number):
                time.sleep(0.0002)
                if flint.ctx.prec != 100 + number:
                    wrong.append(number)

    in_threads(compute)
    assert wrong == []
    assert flint.ctx.prec == before


def test_warnings_are_as_before_after_expressions_were_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Reading one silences the compiler; what else warns is still heard."""
    parse, filters = ast.parse, warnings.filters[:]

    def parse_slowly(text: str, **options: Any) -> Any:
        time.sleep(0.001 * len(text))  # so that they end in another order than they began
        return parse(text, **options)

    with monkeypatch.context() as patched:
        patched.setattr(ast, "parse", parse_slowly)
        for order in (1, -1):
            in_threads(lambda n, o=order: formula(f"{o} + 1" + "0" * (n * o % THREADS)))
    assert warnings.filters == filters
