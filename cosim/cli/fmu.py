"""Commands for FMUs: info, check, build, controller."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cosim import replay, vehicle as vehicles
from cosim.cli.arguments import numbers
from cosim.cli.common import (
    JsonOption,
    answer,
    output_file,
)
from cosim.cli.fmu_view import check_line, check_view, info_line, info_view, rule_view
from cosim.cli.help_text import HelpTyper
from cosim.cli.packed_view import packed_view, plant_view, vehicle_plant_view
from cosim.cli.terminal import typed
from cosim.core import CheckFailedError, InputError
from cosim.fmu import export as exports, inspect
from cosim.fmu.compiled import prebuilt_file
from cosim.fmu.export import DEFAULT_FLAVOUR, Flavour

fmu_app = HelpTyper(
    help="Export a plant or a controller as an FMU; inspect or check any FMU.",
)

FileArgument = Annotated[Path, typer.Argument(help="Any FMU: FMI 1.0, 2.0 or 3.0.")]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        help="File to write the FMU to (default: FILE with .fmu).",
        callback=output_file,
    ),
]
NameOption = Annotated[
    str | None, typer.Option("--name", help="Name of the model (default: the FMU's file name).")
]
FlavourOption = Annotated[
    Flavour,
    typer.Option(
        help="native: FMI 2.0 in C, which every tool loads; native-fmi3: FMI 3.0 in C; "
        "python: a pythonfmu slave for Python hosts, which needs no compiler."
    ),
]
PlatformsOption = Annotated[
    str,
    typer.Option(
        help="Binaries of a native FMU. prebuilt: those that come with the installed "
        "package, for all platforms; if it has none, host. host: compiled for this "
        "machine by its own compiler. all, or names such as "
        "x86_64-linux,x86_64-windows: cross-compiled (needs the extra cross; without "
        "it, all means prebuilt if the package has those binaries). The C sources are "
        "always included."
    ),
]


@fmu_app.command()
def info(file: FileArgument, *, as_json: JsonOption = False) -> None:
    """Describe an FMU: kinds of use, platforms, variables, units, required libraries.

    Nothing is unpacked or executed.

    \b
    cosim fmu info my-plant.fmu
    """
    found = inspect.inspect_fmu(file)
    if found.model is None:
        first = found.findings[0]
        raise InputError(
            "the model description cannot be read",
            where=str(file),
            got=f"{first.where}: {first.what}",
            hint=f"cosim fmu check {file}",
        )
    facts = inspect.fmu_facts(found)
    answer(as_json, lambda: facts, lambda: info_view(facts), line=info_line(facts))


@fmu_app.command()
def check(
    file: Annotated[
        Path | None, typer.Argument(help="Any FMU: FMI 1.0, 2.0 or 3.0.", show_default=False)
    ] = None,
    *,
    rule: Annotated[
        str | None,
        typer.Option(help="Explain a rule instead, by its number or name: V11, start-missing."),
    ] = None,
    run: Annotated[
        bool, typer.Option("--run", help="Also load the binary and run it, in a separate process.")
    ] = False,
    time: Annotated[
        float,
        typer.Option(
            min=0.1, max=3600.0, help="Time limit of --run for each kind of use, in seconds."
        ),
    ] = 30.0,
    as_json: JsonOption = False,
) -> None:
    """Check an FMU for faults: archive, schema, variables, units, dependencies, binaries.

    Each finding is an error, a warning or a note, and explains why it matters. Each finding has a
    rule with a number; --rule explains the rule, with the sections of the standards and an example.
    Anything that this tool cannot read is reported as a warning or a note, never as an error of the
    FMU. The binary is loaded only with --run. It is then initialised, stepped with its start
    values, saved, restored, reset and terminated in a separate process, so that a crash is reported
    as a finding.

    Exit code 0: no errors; 1: at least one error; 2: the file is not an FMU.

    \b
    cosim fmu check my-plant.fmu
    cosim fmu check my-plant.fmu --run
    cosim fmu check --rule start-missing
    """
    if rule is not None:
        explained = inspect.rule_named(rule)
        line = f"{explained.number} {explained.code}: {explained.level}"
        answer(as_json, explained.to_json, lambda: rule_view(explained), line=line)
        return
    if file is None:
        raise InputError("no FMU to check", expected="cosim fmu check FILE, or --rule NAME")
    found = inspect.inspect_fmu(file)
    if run:
        found = found.with_findings(inspect.run_findings(found, time))
    answer(
        as_json,
        lambda: {
            "file": str(file),
            "valid": found.valid,
            "run": run,
            "findings": [each.to_json() for each in found.findings],
        },
        (lambda: check_view(found)) if found.findings else None,
        line=check_line(str(file), found),
        tone="good" if found.valid else "bad",
    )
    if not found.valid:
        raise typer.Exit(CheckFailedError.exit_code)


@fmu_app.command()
def build(
    system: Annotated[
        str,
        typer.Argument(
            metavar="WHAT",
            help="A system FILE.toml, or: paper, auv; a vehicle by name or file; or a built-in "
            "FMU by its name, such as AuvPlant.",
        ),
    ],
    out: OutOption = None,
    name: NameOption = None,
    flavour: FlavourOption = DEFAULT_FLAVOUR,
    platforms: PlatformsOption = "prebuilt",
    initial: Annotated[
        str | None,
        typer.Option(help="Initial state: one number per state, with commas (default: zero)."),
    ] = None,
    *,
    as_json: JsonOption = False,
) -> None:
    """Export a plant FMU: a linear system with delays, Eq. (7), a vehicle, or a built-in FMU.

    For a vehicle file, or a vehicle of the gallery, the FMU has the vehicle's equations in 4 or 6
    degrees of freedom. Its inputs are the commands of thrusters and fins, the current and the
    disturbance; its outputs are eta, nu, and the thrusts and angles after their lags; every number
    of the file is a parameter.

    A linear system may have any dimension and any number of delays. Inputs are u[j] and w[k],
    outputs x[i] and z[l]. Every matrix entry and every delay is a parameter whose start value is
    the number in the file. With one delay: A1[i,j], H1[i,j], delay.d; with several: A1, H1,
    delay.d1, A2, H2, delay.d2, ...

    A delay marked feedback = true belongs to the link between plant and controller. The FMU
    does not contain it; if the delay has an A or H of its own, those are in the FMU.

    \b
    cosim fmu build my-system.toml -o my-plant.fmu
    cosim fmu build paper --initial 1,0
    cosim fmu build remus100 -o remus100.fmu
    cosim fmu build AuvPlant -o AuvPlant.fmu
    """
    file = Path(system)
    target = _target(file, out)
    start = None if initial is None else numbers("--initial", initial)
    if system in exports.CATALOGUE:
        _write_built_in(system, target, flavour, platforms, (name, start), as_json=as_json)
        return
    kind = exports.target_named(flavour, platforms)
    if (vehicle := vehicles.named_vehicle(system)) is not None:
        if start is not None:
            raise InputError(
                "the initial state of a vehicle is set where it runs",
                where="--initial",
                hint='in a scenario: parameters = { "initial.eta.z" = 5.0 }',
            )
        made = vehicles.export_vehicle(vehicle, target, kind=kind, name=name)
        answer(
            as_json,
            made.to_json,
            lambda: vehicle_plant_view(made),
            line=f"packed: {made.path}",
            tone="good",
            then=(typed("fmu info", made.path),),
        )
        return
    packed = exports.export_plant(system, target, kind=kind, name=name, initial=start)
    n, m = packed.system.B.shape
    p, q = packed.system.D1.shape
    answer(
        as_json,
        lambda: {
            "fmu": str(packed.path),
            "model": packed.name,
            "flavour": packed.kind.flavour,
            "sizes": {"x": n, "u": m, "w": q, "z": p},
            "delays": packed.delays,
            "feedback_delay": packed.system.feedback_delay,
            "solver_step": packed.step,
        },
        lambda: plant_view(packed),
        line=f"packed: {packed.path}",
        tone="good",
        then=(typed("fmu info", packed.path),),
    )


@fmu_app.command()
def controller(
    file: Annotated[
        Path,
        typer.Argument(help="A design written by --save, or a trace or FMU with a certificate."),
    ],
    out: OutOption = None,
    name: NameOption = None,
    flavour: FlavourOption = DEFAULT_FLAVOUR,
    platforms: PlatformsOption = "prebuilt",
    sample_time: Annotated[
        float | None,
        typer.Option(help="Sampling period in seconds; 0: sample at every communication point."),
    ] = None,
    clocked: Annotated[
        bool,
        typer.Option(
            "--clocked",
            help="With --flavour native-fmi3: add a Clock that ticks at the sample time, "
            "for masters with event mode.",
        ),
    ] = False,
    limits: Annotated[
        str | None,
        typer.Option(
            help="Largest commands: thrust,moment in N, N m for the vehicle; otherwise one number "
            "per control input."
        ),
    ] = None,
    observer: Annotated[
        bool,
        typer.Option("--observer", help="Export only the observer of an output feedback."),
    ] = False,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch",
            help="Report, while the FMU runs, how much it uses of the ages, the envelope "
            "and the limits that the proof allows. For the age, the FMU has a further "
            "input: the time of the measurement.",
        ),
    ] = False,
    envelope: Annotated[
        str | None,
        typer.Option(
            help="Bounds with which --watch, or an observer, compares the state: one per "
            "state, 0 for none (default: those of the built-in vehicle's design)."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Export a saved design as a controller FMU with gain, limits, certificate and documentation.

    The proof is checked before anything is written. A design for the vehicle gives a
    controller from position and velocity to thrust, like HinfController; any other design gives
    a controller from the state x to the control u. The design of an output feedback gives a
    controller that includes its observer: from measurements, each with the time at which it was
    taken, to the control or, for a vehicle file, to the commands of the actuators about the trim.
    Gain, limits and sample time are parameters; the certificate holds for their start values. A
    scenario that connects this FMU to its plant needs no [design]: the certificate in the FMU is
    used.

    \b
    cosim fmu controller gain.json -o my-controller.fmu
    cosim fmu controller gain.json -o sampled.fmu --sample-time 0.05 --limits 2
    cosim fmu controller gain.json -o watched.fmu --watch
    """
    kind = exports.target_named(flavour, platforms, clocked=clocked)
    found = replay.certificate_in(file)
    if found.mismatch is not None:
        raise InputError(
            "the certificate is not about the gain in this file",
            where=str(file),
            got=found.mismatch,
        )
    bounds = None if limits is None else numbers("--limits", limits)
    packed = exports.export_controller(
        found.data,
        _target(file, out),
        where=str(file),
        kind=kind,
        name=name,
        sample_time=sample_time,
        limits=bounds,
        observer=observer,
        watch=watch,
        envelope=None if envelope is None else numbers("--envelope", envelope),
    )
    answer(
        as_json,
        lambda: {
            "fmu": str(packed.path),
            "model": packed.name,
            "flavour": packed.kind.flavour,
            "form": packed.form,
            "K": packed.K,
            "claim": packed.claim,
            "certificate_sha256": packed.sha256,
        },
        lambda: packed_view(packed),
        line=f"packed: {packed.path}",
        tone="good",
        then=(typed("fmu info", packed.path), typed("certificate check", packed.path)),
    )


def _write_built_in(
    component: str,
    target: Path,
    flavour: Flavour,
    platforms: str,
    beside: tuple[str | None, Any],
    *,
    as_json: bool,
) -> None:
    """Write a built-in FMU; of the installed package one that is ready, with all its binaries."""
    for option, given in zip(("--name", "--initial"), beside, strict=True):
        if given is not None:
            raise InputError(
                "a built-in FMU is as it is",
                where=option,
                hint='parameters in a scenario: parameters = { "initial.eta.z" = 5.0 }',
            )
    ready = prebuilt_file(f"{flavour}/{component}.fmu")
    wanted = "prebuilt" if platforms == "all" and ready is not None else platforms
    exports.write_fmu(component, target, exports.target_named(flavour, wanted))
    binaries = [binary.folder for binary in inspect.inspect_fmu(target).binaries]
    answer(
        as_json,
        lambda: {"fmu": str(target), "model": component, "flavour": flavour, "binaries": binaries},
        line=f"packed: {target}, {flavour}, for {', '.join(binaries) or 'Python'}",
        tone="good",
        then=(typed("fmu info", target),),
    )


def _target(source: Path, out: Path | None) -> Path:
    """Return the file to write an FMU to; refuse the file that the FMU is made from."""
    target = source.with_suffix(".fmu") if out is None else out
    if target.resolve() == source.resolve():
        raise InputError(
            "the FMU would overwrite the file that it is made from",
            where=str(source),
            hint="another file: --out",
        )
    return target
