"""Which variables may be set when: the tables of the standard, slaves, sessions and events."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import pytest
from cli.shell import cosim
from foreign.c_fmu import c_fmu, every
from master.coupled import rewritten
from master.scalar import scalar_fmu
from packed import XML, pack

from cosim.core import InputError
from cosim.fmu import FmuSlave, describe_fmu, may_be_set
from cosim.master import Component, Session, System, make_schedule
from cosim.trace import Trace

Phase = Literal["instantiated", "initialising", "stepping", "failed", "closed"]
PHASES: tuple[Phase, ...] = ("instantiated", "initialising", "stepping", "failed", "closed")
BEFORE, START, ALWAYS = PHASES[:1], PHASES[:2], PHASES[:3]
ALLOWED: dict[tuple[str, str, str | None], tuple[Phase, ...]] = {
    ("parameter", "fixed", "exact"): START,
    ("parameter", "tunable", "exact"): ALWAYS,
    ("calculatedParameter", "fixed", "calculated"): (),
    ("calculatedParameter", "fixed", "approx"): BEFORE,
    ("calculatedParameter", "tunable", "calculated"): (),
    ("calculatedParameter", "tunable", "approx"): BEFORE,
    ("input", "discrete", None): ALWAYS,
    ("input", "continuous", None): ALWAYS,
    ("output", "constant", "exact"): (),
    ("output", "discrete", "calculated"): (),
    ("output", "discrete", "exact"): START,
    ("output", "continuous", "calculated"): (),
    ("output", "continuous", "exact"): START,
    ("output", "continuous", "approx"): BEFORE,
    ("local", "constant", "exact"): (),
    ("local", "fixed", "calculated"): (),
    ("local", "fixed", "approx"): BEFORE,
    ("local", "tunable", "calculated"): (),
    ("local", "tunable", "approx"): BEFORE,
    ("local", "discrete", "exact"): START,
    ("local", "continuous", "calculated"): (),
    ("local", "continuous", "exact"): START,
    ("local", "continuous", "approx"): BEFORE,
}
"""By causality, variability and initial: every combination that the standard has (FMI 2.0.4,
2.2.7) but for some of a discrete variable, with the states in which 4.2.4 lets it be set: before
the initialisation what is exact or approx, in it what is exact, later tunable parameters; inputs
always; constants never. FMI 3.0.1, 2.3.1 says the same."""


def described(version: str, folder: Path) -> Any:
    """The ports of an FMU with a variable of each kind, by what they are."""
    lines, outputs, unknowns = [], [], []
    for number, (causality, variability, initial) in enumerate(ALLOWED):
        start = "" if initial == "calculated" else 'start="1"'
        what = f'name="v{number}" valueReference="{number}" causality="{causality}"'
        what += f' variability="{variability}"' + (f' initial="{initial}"' if initial else "")
        if version == "2.0":
            lines.append(f"<ScalarVariable {what}><Real {start}/></ScalarVariable>")
        else:
            lines.append(f"<Float64 {what} {start}/>")
        if causality == "output":
            outputs.append(number)
        computed = causality in {"output", "calculatedParameter"} and initial != "exact"
        if computed and (version == "2.0" or causality == "output"):
            unknowns.append(number)
    if version == "2.0":
        first, then = (
            "".join(f'<Unknown index="{i + 1}"/>' for i in w) for w in (outputs, unknowns)
        )
        structure = f"<Outputs>{first}</Outputs><InitialUnknowns>{then}</InitialUnknowns>"
        head = 'guid="x"'
    else:
        lines += [
            (
                f'<UInt64 name="n{number}" valueReference="{number}" start="2" '
                f'causality="structuralParameter" variability="{variability}"/>'
            )
            for number, variability in ((100, "fixed"), (101, "tunable"))
        ]
        lines.append('<Float64 name="t" valueReference="102" causality="independent"/>')
        structure = "".join(
            f'<{name} valueReference="{i}"/>'
            for name, which in (("Output", outputs), ("InitialUnknown", unknowns))
            for i in which
        )
        head = 'instantiationToken="x"'
    xml = (
        f'<fmiModelDescription fmiVersion="{version}" modelName="all" {head}>'
        f'<CoSimulation modelIdentifier="all"/><ModelVariables>{"".join(lines)}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )
    return describe_fmu(pack({XML: xml.encode()}, folder / "all.fmu")).ports


@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_settable_phases_follow_the_standard(version: str, tmp_path: Path) -> None:
    """Each kind of variable, in each phase."""
    ports = described(version, tmp_path)
    for number, (kind, phases) in enumerate(ALLOWED.items()):
        found = tuple(phase for phase in PHASES if may_be_set(ports[f"v{number}"], phase))
        assert found == phases, kind
    if version == "3.0":
        for name in ("n100", "n101"):  # in configuration mode, which comes before
            assert [phase for phase in PHASES if may_be_set(ports[name], phase)] == [*BEFORE]
        assert not any(may_be_set(ports["t"], phase) for phase in PHASES)


def test_calculated_parameter_with_an_approximate_start_is_set(tmp_path: Path) -> None:
    """What may be set before the initialisation reaches the FMU; y = c x."""
    fmu = rewritten(
        scalar_fmu(tmp_path),
        tmp_path / "calculated.fmu",
        (
            r'(name="c" valueReference="6" )causality="parameter"',
            r'\1causality="calculatedParameter" initial="approx"',
        ),
        ("<InitialUnknowns>", '<InitialUnknowns><Unknown index="7"/>'),
    )
    with FmuSlave(describe_fmu(fmu), "it", lambda *_: None) as slave:
        slave.initialise({"c": 3.0, "x0": 2.0}, 0.0, 1.0)
        assert slave.read(["y"]) == {"y": 6.0}
        with pytest.raises(InputError, match="c cannot be set after the initialisation"):
            slave.write({"c": 4.0})


def test_session_sets_what_may_be_set_at_points(tmp_path: Path) -> None:
    """Tunable parameters and free inputs take effect; all else is refused and changes nothing."""
    fmu = describe_fmu(c_fmu("every_fmi3.c", every(), tmp_path))
    comm_schedule = make_schedule({}, 5 * 10**8, 2 * 10**9, "align")
    system = System({"it": Component(fmu)}, [], {}, {}, comm_schedule, 1e9)
    refused = (("end_at", 1.0), ("n", 3), ("x", 1.0), ("seven", 7.0), ("Int8.out", 1))
    with Session(system) as session:
        for _ in range(2):
            for name, value in refused:
                before = session.read("it", name)
                with pytest.raises(InputError, match=f"{name} cannot be set after the init"):
                    session.set("it", name, value)
                assert session.read("it", name) == before
            with pytest.raises(InputError, match="time cannot be set after the init"):
                session.set("it", "time", 1.0)
            session.set("it", "gain", 2.0 * session.read("it", "gain"))
            session.set("it", "Int8.in", 5)
            assert session.read("it", "Int8.out") == 5
            session.step()
        # x grows by the gain each second
        assert session.read("it", "x") == 5.0 + 0.5 * 2.0 + 0.5 * 4.0


EVENT = """\
title = "Set on the way"
[run]
end = 1.0
step = 0.1
[components.it]
fmu = "scalar-11.fmu"
parameters = {{ x0 = 1.0, a = 0.0, u = 1.0 }}
[[events]]
at = 0.5
set = {{ "it.{}" = {} }}
"""


def test_event_sets_what_may_be_set_at_points(tmp_path: Path) -> None:
    """x' = a x + b u: a tunable b and the input act from 0.5 s on; a fixed parameter is refused."""
    scalar_fmu(tmp_path)
    for name, value, slope in (("b", 3.0, 3.0), ("u", -2.0, -2.0)):
        (tmp_path / "s.toml").write_text(EVENT.format(name, value))
        result = cosim("run", "s.toml", "--json", "--out", "t.mcap", cwd=tmp_path)
        assert result.code == 0, result.err
        x = Trace(tmp_path / "t.mcap")["it.x"].values
        assert x[[0, 5, 10]] == pytest.approx([1.0, 1.5, 1.5 + 0.5 * slope], rel=1e-12)
    for name, message in (
        ("x0", "it.x0 cannot be set during a run"),
        ("c", "it.c cannot be set during a run"),
        ("x", "it.x is an output"),
    ):
        (tmp_path / "s.toml").write_text(EVENT.format(name, 2.0))
        error = cosim("run", "s.toml", "--json", cwd=tmp_path).error
        assert message in error["what"]
        assert error["exit_code"] == 2
