"""The checker of the standard library agrees with the prover, on every certificate there is."""

from __future__ import annotations

import ast
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_json import changed, leaves
from shared import sampled, spread
from solver_points import benchmark, solved

import cosim
from cosim.core import InputError, NotAchievableError
from cosim.hinf import Delay, DelaySystem, analyse, check_certificate, design
from cosim.hinf.certificate import standalone
from cosim.hinf.certificate.standalone import M, RefusedError, eye, positive
from cosim.models import paper_example

UNREAD = ("theorem", "hypotheses", "name")
"""Sentences and names, which the second checker does not read."""

ROOT = Path(cosim.__file__).parents[1]
ON_FILE = [
    path
    for folder in ("cosim", "fmu_src", "tests")
    for path in sorted((ROOT / folder).glob("**/*.json"))
    if '"variables"' in path.read_text("utf-8") or '"multipliers"' in path.read_text("utf-8")
]
NETWORKED = [[-3.75, -11.5]]


def networked(d: float, **age: Any) -> DelaySystem:
    """The networked loop of the literature."""
    late = Delay(d, np.zeros((2, 2)), feedback=True, **age)
    return DelaySystem([[0, 1], [0, -0.1]], [[0], [0.1]], delays=[late])


def analysis_of(system: DelaySystem, K: Any = None, order: int = 0) -> Any:
    """Its certificate."""
    found = analyse(system, K, order=order)
    assert found.certified, found.reason
    return found.certificate


def theorem_2() -> Any:
    """Section 5 at gamma = 5.05."""
    system = paper_example.system()
    _, K, point = solved(system, (0.6,), (0.2,), 5.05)
    return point.document(system, K)


def guaranteed() -> Any:
    """With every guarantee."""
    constraints: dict[str, Any] = {"decay": 1.0, "gain_limit": 0.5, "peak_control": 0.6}
    more: dict[str, Any] = {"offset": [1.0, 0.5], "energy": 0.1, "damping": 0.6, "within": 2.0}
    return design(paper_example.system(), (0.6,), (0.2,), **constraints, **more).certificate


def refused_at(gamma: float) -> Any:
    """The proof that section 5 has no such design."""
    with pytest.raises(NotAchievableError) as refused:
        design(
            paper_example.system(),
            (0.6,),
            (0.2,),
            gamma=gamma,
            order=None,
            search=False,
            alternatives=False,
        )
    return refused.value.certificate


def two_parameters(kind: str, **age: Any) -> Any:
    """An uncertain stiffness, of 2 x 1, of x and x(t-d), and an uncertain damping as two blocks."""
    system = DelaySystem(
        [[0, 1], [-2, -1]],
        [[0], [1]],
        [[0], [1]],
        [[1, 0], [0, 0]],
        D2=[[0], [0.3]],
        E=[[0.1, 0, 0], [0, 1, 1]],
        H=[[0.4, 0], [0, 0.5]],
        delays=[Delay(0.3, [[0, 0], [-0.5, 0]], [[0.1, 0], [0, 0]], **age)],
        uncertainty_blocks=[[2, 1], [1, 1]],
    )
    if kind == "refutation":
        with pytest.raises(NotAchievableError) as refused:
            design(system, (-1.0,), (1.0,), gamma=0.2, order=None, search=False, alternatives=False)
        return refused.value.certificate
    if kind == "theorem 2":
        constraints: dict[str, Any] = {"decay": 0.2, "order": None, "search": False}
        return design(system, (-1.0,), (1.0,), **constraints).certificate
    return analysis_of(system, order=1)


MADE: dict[str, Callable[[], Any]] = {
    "theorem 2": theorem_2,
    "guarantees": guaranteed,
    "theorem 1": lambda: analysis_of(paper_example.system(), [[0.6432, -0.5679]]),
    "order 2": lambda: analysis_of(benchmark(6.1), order=2),
    "any age": lambda: analysis_of(networked(0.8, any_age=True), NETWORKED),
    "interval": lambda: analysis_of(networked(1.0, any_age=True), NETWORKED, 1),
    "rate": lambda: analysis_of(networked(1.0, rate=0.3, least_age=0.2), NETWORKED, 1),
    "sampled": lambda: analysis_of(networked(1.3, sampled=True, least_age=0.2), NETWORKED, 1),
    "refutation": lambda: refused_at(5.005),
    "blocks, theorem 2": lambda: two_parameters("theorem 2"),
    "blocks, rate": lambda: two_parameters("rate", rate=0.1),
    "blocks, refutation": lambda: two_parameters("refutation"),
    "gamma floor": lambda: refused_at(4.9),
}


@pytest.fixture(scope="module")
def made(request: pytest.FixtureRequest) -> Any:
    """A fresh certificate of one kind, as its file holds it."""
    return json.loads(json.dumps(MADE[request.param]()))


def standalone_accepts(data: Any) -> bool:
    """What the second checker says."""
    try:
        standalone.check(json.dumps(data).encode())
    except RefusedError:
        return False
    return True


def prover_accepts(data: Any) -> bool:
    """What the first one says."""
    try:
        return check_certificate(data).valid
    except InputError:
        return False


@pytest.mark.parametrize("path", sampled(spread(ON_FILE, 3), 10), ids=lambda path: path.name)
def test_every_certificate_on_file_is_proved_twice(path: Path) -> None:
    """The designs of the scenarios, old and new, and the gain of the paper's controller."""
    data = json.loads(path.read_bytes())
    assert prover_accepts(data)
    assert standalone_accepts(data)


def test_there_are_certificates_on_file() -> None:
    """So that the test above cannot pass by finding none."""
    assert len(ON_FILE) >= 7


def opposite(value: Any) -> Any:
    """Change the sign, flag or word."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return -value
    try:
        return str(-Fraction(value))
    except (TypeError, ValueError):
        return "1" if value is None else f"{value}, more or less"


def much(value: Any) -> Any:
    """Change it by a margin."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1000.0
    try:
        return str(-1000 * Fraction(value) - 7)
    except (TypeError, ValueError):
        return opposite(value)


@pytest.mark.parametrize("made", sampled(MADE, 5), indirect=True)
def test_both_refuse_what_was_changed(made: Any) -> None:
    """Entry by entry they agree; nearly all changes are refused, and all of K, X, P or Z."""
    assert prover_accepts(made)
    assert standalone_accepts(made)
    places = list(leaves(made, without=UNREAD))
    step = 1 + len(places) // 40
    accepted = []
    for number, path in enumerate(places[::step]):
        data = changed(made, path, (opposite, much)[number % 2])
        if data == made:
            continue
        expected = prover_accepts(data)
        assert standalone_accepts(data) == expected, path
        accepted += [path] if expected else []
    assert {path[0] for path in accepted} <= {"system", "variables"}  # or the claim still holds
    if made.get("kind") != "gamma floor":  # it is about D1 alone
        assert len(accepted) < 12


@pytest.mark.parametrize("made", ["theorem 2", "sampled"], indirect=True)
@pytest.mark.parametrize(
    "garbage",
    [float("nan"), float("inf"), "nan", "1e999999999", "1/0", "", None, [], {}, True, 10**400],
    ids=lambda value: str(value)[:12],
)
def test_both_refuse_garbage(made: Any, garbage: Any) -> None:
    """In place of a number or a matrix, and without any key."""
    inside = next(iter(made["variables"]["terms"][0]["matrices"])) if "kind" in made else None
    paths: list[tuple[Any, ...]] = [
        ("system", "A", 0, 0),
        ("K", 0, 0),
        ("system", "delays", 0, "d"),
    ]
    paths += [
        ("variables", "P" if inside else "X"),
        ("claim", "delays", 0, "d"),
        ("claim", "gamma"),
    ]
    paths += [("variables", "terms", 0, "matrices", inside, 0, 0)] if inside else []
    for path in paths:
        data = changed(made, path, lambda _: garbage)
        if data != made:
            assert (prover_accepts(data), standalone_accepts(data)) == (False, False), path
    for key in ("claim", "system", "variables", "K"):
        data = {name: value for name, value in made.items() if name != key}
        assert (prover_accepts(data), standalone_accepts(data)) == (False, False), key


def test_it_runs_away_from_the_package(tmp_path: Path) -> None:
    """The folder alone, no site packages: exit 0 with the claim, 1 with the reason."""
    shutil.copytree(Path(standalone.__file__).parent, tmp_path / "standalone")
    command = [sys.executable, "-E", "-S", "-m", "standalone"]
    design_file = ROOT / "cosim/scenario/library/designs/paper-late.json"
    for content, code, word in (
        (design_file.read_text("utf-8"), 0, "stability and H-infinity gain <= gamma"),
        (design_file.read_text("utf-8").replace('"gamma"', '"gama"', 1), 1, "not proved"),
        ('{"kind": "astrology"}', 1, "kind 'astrology' are not read here"),
    ):
        (tmp_path / "c.json").write_text(content, "utf-8")
        done = subprocess.run(  # noqa: S603
            [*command, "c.json"], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == code, done.stderr
        assert word in done.stdout + done.stderr


def test_it_shares_no_code_with_the_prover() -> None:
    """Its files import the standard library and each other alone."""
    folder = Path(standalone.__file__).parent
    for path in folder.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom):
                top = str(node.module).split(".")[0]
                assert node.level == 1 or top in sys.stdlib_module_names
                assert node.level < 2
            elif isinstance(node, ast.Import):
                assert {x.name for x in node.names} <= sys.stdlib_module_names


def test_positive_is_strict_however_close() -> None:
    """2^-90 above a singular matrix is positive, 2^-90 below and the singular one are not."""
    rows = [[1, 2, 3], [2, 5, 7], [3, 7, 10]]  # singular: the third is the sum of the others
    A = M({(i, j): Fraction(x) for i, row in enumerate(rows) for j, x in enumerate(row)})
    small = Fraction(1, 2**90)
    positive(A + small * eye(3), 3, "A")
    for off in (-small, 0 * small):
        with pytest.raises(RefusedError, match="not positive"):
            positive(A + off * eye(3), 3, "A")
    with pytest.raises(RefusedError, match="symmetric"):
        positive(A + eye(3) + M({(0, 1): small}), 3, "A")
