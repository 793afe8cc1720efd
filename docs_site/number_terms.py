"""What the expressions of `numbers.toml` are made of: loops, their proofs, answers of commands."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from cosim import hinf
from cosim.hinf import Delay, DelaySystem
from cosim.models import TABLE_1

ROOT = Path(__file__).parents[1]
NETWORKED = ((-3.75, -11.5),)
"""The gain of the networked loop (Zhang, Branicky, Phillips 2001)."""


def networked(d: float = 0.5, **age: Any) -> DelaySystem:
    """Return the networked loop, x' = [0 1; 0 -.1] x + [0; .1] u."""
    late = Delay(d, np.zeros((2, 2)), feedback=True, **age)
    return DelaySystem([[0.0, 1.0], [0.0, -0.1]], [[0.0], [0.1]], delays=[late])


def integrator(**age: Any) -> DelaySystem:
    """Return x' = u, for the gain -1: x' = -x(t - tau)."""
    return DelaySystem([[0.0]], [[1.0]], delays=[Delay(0.5, [[0.0]], feedback=True, **age)])


@cache
def greatest(system: DelaySystem, gain: Any = NETWORKED, order: Any = "auto") -> float:
    """Return the greatest first delay [s] that is certified at an order, the others kept."""
    found = hinf.certified_delay(system, gain, order=order)
    return math.nan if found.delay is None else found.delay


@cache
def margin(system: DelaySystem, gain: Any = NETWORKED) -> float:
    """Return the first delay [s] at which the nominal loop loses stability, computed."""
    return float((hinf.delay_margin(system, np.array(gain)) or [math.nan])[0] or math.inf)


def regular_limit() -> float:
    """Return the regular sampling interval [s] at which the networked loop loses stability."""

    def radius(h: float) -> float:
        A, B = networked().A, networked().B
        both = scipy.linalg.expm(h * np.block([[A, B], [np.zeros((1, 3))]]))
        own = both[:2, :2] + both[:2, 2:] @ np.array(NETWORKED)
        return float(np.abs(np.linalg.eigvals(own)).max() - 1)

    return float(scipy.optimize.brentq(radius, 1.0, 2.0, xtol=1e-12))


@cache
def pinned(name: str) -> Any:
    """Return a design of the scenarios, such as "auv-1.25s"."""
    folder = ROOT / "cosim" / "scenario" / "library" / "designs"
    path = folder / f"{name}.json"
    return hinf.Result.from_json(hinf.certificate.read_certificate(path), where=path.name)


def vehicle(state_any_age: bool = True, **loop_age: Any) -> DelaySystem:  # noqa: FBT001, FBT002
    """Return the system of the pinned gain auv-1.25s, with another age of its loop.

    state_any_age : of its state delay, .5 s; otherwise that is constant.
    """
    late = [
        Delay(x.d, x.A, x.H, x.feedback, **(loop_age or {"any_age": True}))
        if x.feedback
        else Delay(x.d, x.A, x.H, x.feedback, state_any_age)
        for x in pinned("auv-1.25s").system.delays
    ]
    system: DelaySystem = replace(pinned("auv-1.25s").system, delays=tuple(late))
    return system


@cache
def norm(system: DelaySystem, gain: Any = None) -> float:
    """Return the norm of the nominal loop; `gain` None: that of auv-1.25s."""
    K = pinned("auv-1.25s").K if gain is None else np.array(gain)
    found = hinf.delay_lti.nominal_figures_of(system, K).exact_norm
    return math.nan if found is None else found


@cache
def gamma(system: DelaySystem, gain: Any = None, order: Any = "auto") -> float:
    """Return the least gamma that is certified; `gain` None: that of auv-1.25s."""
    K = pinned("auv-1.25s").K if gain is None else gain
    found = hinf.analyse(system, K, order=order)
    return math.nan if found.gamma is None else found.gamma


@cache
def files_of(page: str) -> Path:
    """Return a folder with the files that the blocks of a page of docs are."""
    folder = Path(tempfile.mkdtemp(prefix="pages-"))
    text = (ROOT / "docs" / page).read_text("utf-8")
    for name, content in re.findall(r"```\w+\n(?=# (\S+\.\w+)\n)(.*?)```", text, re.DOTALL):
        (folder / name).write_text(content, "utf-8")
    return folder


@cache
def answer(page: str, line: str) -> Any:
    """Return what a command prints with `--json`, in the folder of the files of a page."""
    name, *arguments = shlex.split(line)
    done = subprocess.run(  # noqa: S603 - of numbers.toml
        [sys.executable, "-m", name, *arguments, "--json"],
        cwd=files_of(page),
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def limit(assumption: str) -> float:
    """Return up to which age [s] the gain of the tutorial's heading is stable, so assumed."""
    found = answer("tutorial/index.md", "cosim age heading.toml --ages 0.4,0.8")
    if found["gain_age_s"] != 0.8:
        raise ValueError(f"the page is about the gain for 0.8 s, got {found['gain_age_s']} s")
    return float(next(x["age"] for x in found["limits"] if x["assumption"] == assumption))


def mass() -> float:
    """Return the mass [kg] of the paper's vehicle."""
    return float(TABLE_1["mass"])
