"""Checks that the keys of a study agree with each other; errors name the place in the file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from cosim.core import InputError, line_of
from cosim.study.schema import RESERVED, RarePart, SampledAxis, Study

_LEAST_SAMPLES = 100  # of a rare event: ten chains

Place = Callable[..., str]
"""Maps the keys that lead to an entry of a study to its place, for messages."""


def nowhere(*path: str | int) -> str:
    """Return the place of an entry in a study that was not read from a file."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in path)[1:]


def in_file(text: str, file: str) -> Place:
    """Return the function that gives places in the TOML text of a file."""

    def place(*path: str | int) -> str:
        line = line_of(text, path)
        return f"{file}:{line}: {nowhere(*path)}" if line else f"{file}: {nowhere(*path)}"

    return place


def check_consistent(study: Study, place: Place = nowhere) -> None:
    """Check that names are unique and that the names in use exist.

    Raises
    ------
    InputError : the first fault.
    """
    _check_columns(study, place)
    _check_targets(study, place)
    if study.samples > 1 and not any(isinstance(a, SampledAxis) for a in study.vary):
        raise InputError(
            "samples needs an axis to draw values for",
            where=place("samples"),
            expected="an axis of kind 'random', 'sobol', 'latin' or 'saltelli'",
            got=f"samples = {study.samples}",
        )
    _check_stop(study, place)
    _check_rare(study, place)
    _check_sampled(study, place)
    if study.worst is not None:
        _one_of("metric", study.worst[1].removeprefix("-"), study.metrics, place("traces"))
    part = study.stability
    if part is None:
        return
    for kind, keys, known in (
        ("axis", ("delay", "loss"), [axis.column for axis in study.vary]),
        ("metric", ("stable", "gain", "certified"), list(study.metrics)),
    ):
        for key in keys:
            if getattr(part, key) is not None:
                _one_of(kind, getattr(part, key), known, place("stability", key))


CLAIMED = "metrics.guarantee_claimed"
"""Figure of a run that says whether its guarantee is claimed: every assumption was met."""


def certified_metric(study: Study) -> str | None:
    """Return the metric by which runs count as certified: the whole guarantee, or none."""
    name = None if study.stability is None else study.stability.certified
    return name if name is not None and study.metrics[name].path == CLAIMED else None


def check_certified(study: Study, place: Place = nowhere) -> None:
    """Check that a study calls certified what meets every assumption, not one of them.

    Studies of older versions that were begun go on; in them nothing counts as certified.

    Raises
    ------
    InputError : another metric.
    """
    part = study.stability
    if part is not None and part.certified is not None and certified_metric(study) is None:
        raise InputError(
            "a run is certified where every assumption of its guarantee was met",
            where=place("stability", "certified"),
            expected=f"a metric that is {CLAIMED!r}",
            got=f"{part.certified} = {study.metrics[part.certified].path!r}",
        )


def _check_sampled(study: Study, place: Place) -> None:
    """Check the sampled axes that depend on each other."""
    sampled = [axis.column for axis in study.vary if isinstance(axis, SampledAxis)]
    for i, axis in enumerate(study.vary):
        if isinstance(axis, SampledAxis) and axis.given is not None:
            earlier = sampled[: sampled.index(axis.column)]
            _one_of("earlier sampled axis", axis.given, earlier, place("vary", i))
            if axis.kind == "saltelli":
                raise InputError(
                    "sensitivity indices need independent axes",
                    where=place("vary", i),
                    expected="no given",
                    got=axis.given,
                )
    for i, correlation in enumerate(study.correlations):
        for name in correlation.axes:
            _one_of("sampled axis", name, sampled, place("correlations", i))


def _check_stop(study: Study, place: Place) -> None:
    """Check that a study with `stop` has independent runs that are alike."""
    if study.stop is None:
        return
    where = place("stop")
    if study.rare is not None:
        raise InputError("a study has stop or rare", where=where, got="both")
    _one_of("metric", study.stop.metric, study.metrics, where)
    kinds = [axis.kind for axis in study.vary]
    if set(kinds) != {"random"} and kinds != ["replicates"]:
        raise InputError(
            "a study can stop at a width if its runs are independent draws",
            where=where,
            expected="axes of kind 'random' alone, or one of kind 'replicates'",
            got=", ".join(kinds),
            hint="draw seeds beside other values: kind = 'random', path = 'run.seed', "
            "integers = [1, 2147483647]",
        )


def _check_rare(study: Study, place: Place) -> None:
    """Check that the runs of a study with `rare` can be drawn one from another."""
    part = study.rare
    if part is None:
        return
    where = place("rare")
    _one_of("metric", part.metric, study.metrics, where)
    if study.metrics[part.metric].asks:
        raise InputError(
            "the metric of a rare event is a number",
            where=where,
            expected="a metric without below, above and equals: the bound belongs to rare",
            got=part.metric,
        )
    kinds = [axis.kind for axis in study.vary]
    if set(kinds) != {"random"}:
        raise InputError(
            "the runs of a rare event are drawn one from another",
            where=where,
            expected="axes of kind 'random' alone",
            got=", ".join(kinds),
            hint="for seeds: kind = 'random', path = 'run.seed', integers = [1, 2147483647]",
        )
    if study.samples < _LEAST_SAMPLES or _per_level(study, part) % 10:
        raise InputError(
            "a level cannot be divided into chains",
            where=place("samples" if part.pilot is None else "rare"),
            expected=f"a multiple of 10 from {_LEAST_SAMPLES} on; samples = 1000 is usual",
            got=f"{_per_level(study, part)} runs per level",
        )


def _per_level(study: Study, part: RarePart) -> int:
    return study.samples if part.method == "subset" else part.pilot or study.samples


def _check_columns(study: Study, place: Place) -> None:
    own = ("level",) if study.rare is not None else ()
    taken = dict.fromkeys((*RESERVED, *own), "every table has this column")
    named: list[tuple[str, tuple[str | int, ...]]] = [
        *((axis.column, ("vary", i)) for i, axis in enumerate(study.vary)),
        *((name, ("metrics", name)) for name in study.metrics),
    ]
    for name, path in named:
        if name in taken:
            raise InputError(
                f"the table would have two columns {name!r}",
                where=place(*path),
                expected="another name",
                got=taken[name],
            )
        taken[name] = f"{nowhere(*path)} has this name"


def _check_targets(study: Study, place: Place) -> None:
    moved: dict[str, int] = {}
    for i, axis in enumerate(study.vary):
        for path in axis.places:
            if path in moved:
                raise InputError(
                    f"two axes change {path}",
                    where=place("vary", i),
                    got=f"vary[{moved[path]}] and vary[{i}]",
                )
            moved[path] = i


def _one_of(kind: str, name: str, known: Iterable[Any], where: str) -> None:
    if name not in known:
        raise InputError.unknown(kind, name, known, where=where)


def changed_error(error: InputError, **changes: str | None) -> InputError:
    """Return the same error with other parts, such as another place."""
    parts = ("where", "expected", "got", "hint")
    return InputError(error.what, **{part: getattr(error, part) for part in parts} | changes)
