"""Several blocks of uncertainty: more is proved than for one full block, and nothing untrue."""

from __future__ import annotations

import itertools
import json
import zipfile
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.core import InputError
from cosim.fmu.export import FmuTarget, export_controller
from cosim.hinf import Delay, DelaySystem, analyse, check_certificate, design, hinf_norm
from cosim.hinf.certificate import (
    differences,
    standalone,
    system_from_json,
    system_to_json,
    theorem_of,
)
from cosim.hinf.certificate.standalone import RefusedError
from cosim.hinf.delay_lti import close
from cosim.hinf.lmi import Condition, GainLmi, scalar_multiplier
from cosim.hinf.problem import (
    system_from_toml,
    with_integral,
    without_integrals,
    without_uncertainty,
)
from cosim.hinf.synthesis import LoopGain

PARAMETERS = [[1, 1], [1, 1]]
NO_GAIN = np.zeros((1, 2))


def spring(blocks: Any = PARAMETERS, scale: float = 1.0) -> DelaySystem:
    """Mass, spring (a part of it late) and damper; stiffness and damping are uncertain."""
    return DelaySystem(
        [[0, 1], [-2, -1]],
        [[0], [1]],
        [[0], [1]],
        [[1, 0], [0, 0]],
        D2=[[0], [0.3]],
        E=[[0, 0], [1, 1]],
        H=scale * np.array([[0.4, 0], [0, 0.5]]),
        delays=[Delay(0.3, [[0, 0], [-0.5, 0]])],
        name="spring",
        uncertainty_blocks=blocks,
    )


def gains_at_vertices(system: DelaySystem, K: Any) -> list[float]:
    """Return the exact norms of the loop where every parameter is at an end of its interval."""
    found = []
    for ends in itertools.product((-1.0, 1.0), repeat=2):
        changed = system.E @ np.diag(ends) @ system.H
        norm = hinf_norm(close(replace(without_uncertainty(system), A=system.A + changed), K))
        assert norm is not None
        found.append(norm.value)
    return found


@pytest.fixture(scope="module")
def worst() -> float:
    """The greatest gain of the spring over parameters e^{i phi}, written out at each frequency."""
    system = spring()
    omega, phases = np.linspace(0.8, 1.6, 50), np.exp(1j * np.linspace(0, 2 * np.pi, 41))
    first, second = (x.ravel() for x in np.meshgrid(phases, phases))
    changes = np.einsum("ik,kp,kj->pij", system.E, np.array([first, second]), system.H)
    greatest = 0.0
    for w in omega:
        late = np.exp(-0.3j * w) * system.delays[0].A
        x = np.linalg.solve(1j * w * np.eye(2) - system.A - late - changes, system.C[None])
        greatest = max(greatest, float(np.abs(x[:, 0]).max()))  # z = x_1
    return greatest


def test_two_parameters_cost_less_than_one_full_block_and_gamma_is_sharp(worst: float) -> None:
    """Above all real and complex parameters, within 2 % of the worst, and below the full block."""
    full, blocks = (analyse(spring(own), NO_GAIN, order=1) for own in (None, PARAMETERS))
    assert full.gamma is not None
    assert blocks.gamma is not None
    assert max(gains_at_vertices(spring(), NO_GAIN)) < blocks.gamma < 0.7 * full.gamma
    assert worst < blocks.gamma < 1.02 * worst


def test_a_designed_gain_is_better_with_blocks_and_holds_at_every_vertex() -> None:
    """Theorem 2 at the same k1, k2, without any further route."""
    full, blocks = (
        design(spring(own), (-1.0,), (1.0,), order=None, search=False) for own in (None, PARAMETERS)
    )
    assert full.gamma is not None
    assert blocks.gamma is not None
    assert max(gains_at_vertices(spring(), blocks.K)) <= blocks.gamma < full.gamma


def test_stability_that_no_full_block_has_is_certified_for_parameters() -> None:
    """A full F within its bound makes a root cross the axis: the gain from p to q exceeds one."""
    far, alone = spring(scale=1.1), 0.0
    for w in np.linspace(0.5, 2.0, 400):
        late = np.exp(-0.3j * w) * far.delays[0].A
        G = far.H @ np.linalg.inv(1j * w * np.eye(2) - far.A - late) @ far.E
        alone = max(alone, float(np.linalg.norm(G, 2)))
    assert alone > 1
    assert not analyse(replace(far, uncertainty_blocks=None), NO_GAIN, order=1).certified
    assert analyse(far, NO_GAIN, order=1).certified


@pytest.mark.parametrize(
    "age", [{}, {"sampled": True, "least_age": 0.1}], ids=["constant", "sampled"]
)
def test_the_units_of_a_block_do_not_matter(age: dict[str, Any]) -> None:
    """E_1 F_1 H_1 with E_1 a million times larger, H_1 smaller: the same gamma, proved."""
    plain = replace(spring(), delays=[Delay(0.3, [[0, 0], [-0.5, 0]], **age)])
    other = replace(plain, E=plain.E * [1e6, 1e-3], H=plain.H / np.array([[1e6], [1e-3]]))
    first, second = (analyse(own, NO_GAIN, order=1).gamma for own in (plain, other))
    assert first is not None
    assert second == pytest.approx(first, rel=1e-4)


def axes(blocks: Any) -> DelaySystem:
    """Two loops of their own, the columns of E in the other order than the states."""
    return DelaySystem(
        np.diag([-1.0, -2.0]),
        C=np.eye(2),
        D=np.eye(2),
        E=[[0, 0.3], [0.5, 0]],
        H=[[0, 1], [1, 0]],
        delays=[Delay(0.5, np.diag([-0.6, 0.7]), any_age=True)],
        uncertainty_blocks=blocks,
    )


@pytest.mark.parametrize("order", [0, 1])
def test_loops_that_do_not_meet_have_the_worse_of_their_gains(order: int) -> None:
    """Cut into parts, with the multiplier of a block in the part that the block belongs to."""
    whole = axes(PARAMETERS)
    each = []
    for i in range(2):
        at, block = slice(i, i + 1), slice(1 - i, 2 - i)
        part = DelaySystem(
            whole.A[at, at],
            C=[[1]],
            D=[[1]],
            E=whole.E[at, block],
            H=whole.H[block, at],
            delays=[Delay(0.5, whole.delays[0].A[at, at], any_age=True)],
        )
        each.append(analyse(part, order=order).gamma or 0.0)
    found = analyse(whole, order=order).gamma
    assert found == pytest.approx(max(each), rel=2e-3)


@pytest.fixture(scope="module")
def certificate() -> Any:
    """Of the spring with two parameters, as its file holds it."""
    return json.loads(json.dumps(analyse(spring(), NO_GAIN, order=1).certificate))


def test_the_gain_of_the_lmi_of_the_ages_is_confirmed_by_its_analysis() -> None:
    """The two LMIs are written apart: what a design says of its gain holds for that gain."""
    late = [Delay(0.3, [[0, 0], [-0.5, 0]], any_age=True)]
    system = replace(spring(), delays=late)
    made = GainLmi(system, 1, NO_GAIN, 1.0, ["interval"]).least_gamma(
        scalar_multiplier(0.3, system)
    )
    assert made is not None
    again = Condition(system, made[1], 1, ["interval"], performance=True).least_gamma(
        [0.3], made[0]
    )
    assert again is not None
    assert again < made[0] * (1 + 1e-4)


def accepted(data: Any) -> tuple[bool, bool]:
    """Return what the prover says, and what the second checker says."""
    verdicts = []
    try:
        verdicts.append(check_certificate(data).valid)
    except InputError:
        verdicts.append(False)
    try:
        standalone.check(json.dumps(data).encode())
        verdicts.append(True)
    except RefusedError:
        verdicts.append(False)
    return verdicts[0], verdicts[1]


def test_the_certificate_says_which_F_it_covers(certificate: Any, tmp_path: Path) -> None:
    """In its claim, in its theorem and on the page of an FMU, and both checkers prove it."""
    assert certificate["claim"]["uncertainty_blocks"] == PARAMETERS
    (sentence,) = [text for text in certificate["theorem"] if text.startswith("uncertainty")]
    assert "F = diag(F_1, F_2), F_1 1 x 1, F_2 1 x 1" in sentence
    assert "F_i(t)'F_i(t) <= I" in sentence
    assert "real or complex" in sentence
    path = tmp_path / "k.fmu"
    export_controller(certificate, path, where="a test", kind=FmuTarget("python"))
    with zipfile.ZipFile(path) as fmu:
        page = fmu.read("documentation/index.html").decode()
    assert "F&#x27;F ≤ I, block diagonal with blocks 1 x 1, 1 x 1" in page
    assert accepted(certificate) == (True, True)


def test_both_checkers_refuse_other_multipliers_and_other_blocks(certificate: Any) -> None:
    """One number for two blocks, exchanged ones, a negative one; a claim about every full F."""
    first, second = certificate["variables"]["eps"]
    assert Fraction(first) != Fraction(second)
    for eps in (first, [first], [second, first], [first, first], [first, "-" + second], None, []):
        data = certificate | {"variables": certificate["variables"] | {"eps": eps}}
        assert accepted(data) == (False, False), eps
    full = {key: x for key, x in certificate["claim"].items() if key != "uncertainty_blocks"}
    one, half = [[1, 1], [1, True]], [[1.5, 1], [1.5, 1]]
    for sizes in ([[2, 2]], [[1, 2], [1, 0]], [[1, 1]], one, half, "F", [1, 1], None):
        system = certificate["system"] | {"uncertainty_blocks": sizes}
        if sizes is None:  # every F of two rows and two columns, with one multiplier of them
            del system["uncertainty_blocks"]
        for eps in (certificate["variables"]["eps"], first, second):
            variables = certificate["variables"] | {"eps": eps}
            for claim in (certificate["claim"], full):
                own = {"claim": claim, "theorem": theorem_of(claim), "system": system}
                assert accepted(certificate | own | {"variables": variables}) == (False, False)


FILE = """
[system]
A = [[0, 1], [-2, -1]]
B = [[0], [1]]
E = [[0, 0, 1], [1, 1, 0]]
H = [[0.4, 0], [0, 0.5]]
uncertainty_blocks = [[2, 1], [1, 1]]
"""


def read(text: str) -> DelaySystem:
    """Read a system file."""
    return system_from_toml(text, where="file.toml", name="file").system


def test_blocks_are_read_and_written_and_kept() -> None:
    """From TOML, to JSON and back; one block is no list; integrals keep them."""
    system = read(FILE)
    assert system.uncertainty_blocks == ((2, 1), (1, 1))
    assert system.blocks == ((slice(0, 2), slice(0, 1)), (slice(2, 3), slice(1, 2)))
    again = system_from_json(json.loads(json.dumps(system_to_json(system))))
    assert not list(differences(system, again))
    full = read(FILE.replace("[[2, 1], [1, 1]]", "[[3, 2]]"))
    assert full.uncertainty_blocks is None
    assert full.blocks == ((slice(0, 3), slice(0, 2)),)
    assert "uncertainty_blocks" not in system_to_json(full)
    assert list(differences(system, full)) == ["uncertainty_blocks: ((2, 1), (1, 1)) and None"]
    wider = with_integral(system, [0])
    assert (
        wider.uncertainty_blocks == without_integrals(wider).uncertainty_blocks == ((2, 1), (1, 1))
    )
    assert without_uncertainty(system).blocks == ()


@pytest.mark.parametrize(
    ("blocks", "words"),
    [
        ("[[1, 1], [1, 1]]", ["blocks of 3 columns of E and 2 rows of H", "got 2 and 2"]),
        ("[[3, 2], [0, 0]]", ["at least one column and one row"]),
        (
            "[[1.5, 1], [1.5, 1]]",
            ["blocks[0][0]", "got: 1.5", "two parameters are [[1, 1], [1, 1]]"],
        ),
        ("[3, 2]", ["blocks[0]", "a list", "got: 3", "pairs, columns of E"]),
        ("[[true, 1], [2, 1]]", ["blocks[0][0]", "a whole number", "pairs"]),
    ],
)
def test_blocks_that_do_not_fit_are_refused(blocks: str, words: list[str]) -> None:
    """With the key, what was expected and what was got."""
    with pytest.raises(InputError) as refused:
        read(FILE.replace("[[2, 1], [1, 1]]", blocks))
    for word in ("file.toml", *words):
        assert word in str(refused.value)


def test_the_scaled_gain_of_a_descent_is_that_of_a_grid_of_scalings(worst: float) -> None:
    """At its best scalings the gain of phases is nearly met; that of F alone is D G D^-1's norm."""
    system, grid = spring(), np.linspace(-3, 3, 16)
    loop, alone = LoopGain(system), LoopGain(system, only_uncertain=True)
    best = min(loop.gain(NO_GAIN, np.array([a, b])).value for a in grid for b in grid)
    assert worst < np.exp(best) < 1.1 * worst
    D = np.diag([np.exp(0.4), 1.0])
    truth = 0.0
    for w in np.linspace(0.5, 2.0, 2000):
        late = np.exp(-0.3j * w) * system.delays[0].A
        G = system.H @ np.linalg.inv(1j * w * np.eye(2) - system.A - late) @ system.E
        truth = max(truth, float(np.linalg.norm(D @ G @ np.linalg.inv(D), 2)))
    found = alone.gain(NO_GAIN, np.array([0.4, 0.0])).value
    assert np.exp(found) == pytest.approx(truth, rel=1e-4)
