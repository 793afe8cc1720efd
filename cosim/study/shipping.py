"""Give the workers of a cluster what runs read by its content: they share no folder with anyone.

The scheduler holds the contents while a study runs. A worker process asks for those that the cache
of its host lacks, and checks the hash of each. Traces that a worker cannot write into the folder of
the study come back with the results.

What has an absolute path is not shipped, as it stands in the scenario: every worker must see the
same file there.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

from cosim.core import ComponentError, InputError, cache_folder, unreadable, write_whole
from cosim.scenario import split
from cosim.study.batch import Job, check_software, runner_of
from cosim.study.study_runner import BaseScenario

_OPERATION = "auv_cosim_content"
_JOBS_KEPT = 4
_DESIGN_FILES = (".json", ".fmu", ".toml")


@dataclass(frozen=True)
class Shipment:
    """The files that the runs of a study read, by their SHA-256.

    Attributes
    ----------
    fmus : FMU reference -> (name of the file, hash).
    files : path relative to the scenario's folder, which may begin with "..", -> hash.
    outside : absolute path -> hash of a file that each worker must have itself.
    """

    fmus: dict[str, tuple[str, str]] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)
    outside: dict[str, str] = field(default_factory=dict)


def shipment_of(job: Job) -> tuple[Shipment, dict[str, bytes]]:
    """Return what the runs of a study read, and the contents by hash.

    Raises
    ------
    InputError : a file that the study names cannot be read.
    """
    shipment = Shipment()
    contents: dict[str, bytes] = {}
    for fmu in job.hashes:
        path = runner_of(job).fmu_cache.find(fmu).path
        content = _read(path)
        shipment.fmus[fmu] = path.name, _enter(contents, content)
        if shipment.fmus[fmu][1] != job.hashes[fmu]:
            raise _changed(path, job.hashes[fmu], shipment.fmus[fmu][1])
    for name in sorted(_named_files(job)):
        content = _read(job.base.folder / name)
        if Path(name).is_absolute():
            shipment.outside[name] = hashlib.sha256(content).hexdigest()
        else:
            shipment.files[Path(os.path.normpath(name)).as_posix()] = _enter(contents, content)
    for name in sorted(_parameter_files(job.base)):
        shipment.outside[name] = hashlib.sha256(_read(Path(name))).hexdigest()
    return shipment, contents


def _enter(contents: dict[str, bytes], content: bytes) -> str:
    digest = hashlib.sha256(content).hexdigest()
    contents[digest] = content
    return digest


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error, what="a file of the study cannot be shipped") from error


def _changed(path: Path, expected: str, got: str) -> InputError:
    return InputError(
        "this file is not the one that the study was started with",
        where=str(path),
        expected=f"SHA-256 {expected}",
        got=got,
    )


def _named_files(job: Job) -> set[str]:
    """Return the files that [design] names, in the scenario and in the study."""
    found: set[Any] = set()
    if job.base.scenario.design is not None:
        part = job.base.scenario.design
        found |= {part.file, part.system}
    given = [*job.study.set.items()]
    for axis in job.study.vary:
        rows = getattr(axis, "rows", None) or []
        values = getattr(axis, "values", None) or getattr(axis, "choice", None) or []
        given += [(path, row[i]) for i, path in enumerate(axis.places) for row in rows]
        given += [(path, value) for path in axis.places for value in values]
    for path, value in given:
        match split(path), value:
            case ("design", "file" | "system"), str():
                found.add(value)
            case ("design",), dict():
                found |= {value.get("file"), value.get("system")}
    return {name for name in found if isinstance(name, str) and name.endswith(_DESIGN_FILES)}


def _parameter_files(base: BaseScenario) -> set[str]:
    """Return the files that parameters of components name by an absolute path."""
    values = (v for part in base.scenario.components.values() for v in part.parameters.values())
    return {v for v in values if isinstance(v, str) and Path(v).is_absolute() and Path(v).is_file()}


def received(
    shipment: Shipment, base: BaseScenario, here: Path, fetch: Callable[[str], bytes]
) -> BaseScenario:
    """Lay the files of a study out on a worker; return the scenario as it is there.

    Parameters
    ----------
    here : an empty folder for them; what is large lies in the cache of the host.
    fetch : returns a content by its hash.

    Raises
    ------
    InputError : a file that is not shipped is not here, or is another one.
    """
    for name, digest in shipment.outside.items():
        path = Path(name)
        got = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else "no such file"
        if got != digest:
            raise InputError(
                "a worker lacks a file that is not shipped, since its path is absolute",
                where=name,
                expected=f"SHA-256 {digest}",
                got=got,
                hint="a path relative to the scenario's folder is shipped; or put the same file "
                "there on every worker",
            )
    parents = [PurePosixPath(name).parts.count("..") for name in shipment.files]
    folder = here.joinpath("files", *["in"] * max(parents, default=0))
    folder.mkdir(parents=True)
    for name, digest in shipment.files.items():
        path = Path(os.path.normpath(folder / name))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_verified(digest, fetch))
    # an FMU is found by its hash, below the folder of FMUs
    fmus = here / "fmus"
    for name, digest in shipment.fmus.values():
        target = fmus / digest / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists():
            _place(target, digest, fetch)
    return replace(base, folder=folder, fmus=fmus)


def _place(target: Path, digest: str, fetch: Callable[[str], bytes]) -> None:
    """Put a content in its place: a link into the cache of this host, or else a copy."""
    kept = cache_folder() / "shipped" / f"{digest}{target.suffix}"
    with suppress(OSError):
        if not kept.is_file() or hashlib.sha256(kept.read_bytes()).hexdigest() != digest:
            kept.parent.mkdir(parents=True, exist_ok=True)
            write_whole(kept, _verified(digest, fetch))
        target.symlink_to(kept)
        return
    target.write_bytes(_verified(digest, fetch))


def _verified(digest: str, fetch: Callable[[str], bytes]) -> bytes:
    content = fetch(digest)
    got = hashlib.sha256(content).hexdigest()
    if got != digest:
        raise InputError(
            "what arrived at a worker is not what was sent", expected=f"SHA-256 {digest}", got=got
        )
    return content


@dataclass(frozen=True)
class Ticket:
    """Stands for a job in the messages of its batches; a worker process asks for the job once.

    Attributes
    ----------
    offer : names the contents on the scheduler, at random.
    job : hash of the job and its shipment.
    software : as in `Job`.
    traces : folder for traces of the process that started the study, if workers may not see it.
    """

    offer: str
    job: str
    software: dict[str, str]
    traces: Path | None

    @property
    def mark(self) -> str:
        """Name of the file by which a worker knows the folder `traces`."""
        return f"{self.offer}.mark"


class Offer:
    """What a scheduler hands out to workers while a study runs.

    Parameters
    ----------
    client : of Dask.
    """

    def __init__(self, client: Any) -> None:
        self._client = client
        self._name = os.urandom(8).hex()
        self._marks: set[Path] = set()
        self._tickets: dict[str, Ticket] = {}
        self._files: tuple[Shipment, dict[str, bytes]] | None = None

    def ticket(self, job: Job) -> Ticket:
        """Offer a job; return what stands for it.

        Raises
        ------
        InputError : see `shipment_of`.
        """
        if self._files is None:
            self._files = shipment_of(job)
        shipment, contents = self._files
        content = pickle.dumps((job, shipment))
        digest = hashlib.sha256(content).hexdigest()
        if digest not in self._tickets:
            new = {digest: content} if self._tickets else {digest: content, **contents}
            self._hand_out(new)
            ticket = Ticket(self._name, digest, job.software, job.traces)
            if ticket.traces is not None:
                ticket.traces.mkdir(parents=True, exist_ok=True)
                for left in ticket.traces.glob("*.mark"):  # by a process that was killed
                    left.unlink()
                (ticket.traces / ticket.mark).write_text(self._name)
                self._marks.add(ticket.traces / ticket.mark)
            self._tickets[digest] = ticket
        return self._tickets[digest]

    def _hand_out(self, contents: dict[str, bytes]) -> None:
        try:
            self._client.run_on_scheduler(_offer, name=self._name, contents=contents)
        except Exception as error:  # of many types: it is gone, or lacks this package
            raise ComponentError(
                "the scheduler cannot hand out what workers need",
                where="workers",
                expected="a scheduler that runs, with the same auv-cosim",
                got=f"{type(error).__name__}: {error}"[:300],
                hint="finished runs are kept: the same command continues",
            ) from error

    def close(self) -> None:
        """Withdraw everything."""
        for mark in self._marks:
            mark.unlink(missing_ok=True)
        if self._tickets:
            with suppress(Exception):  # the scheduler may be gone, with all that it had
                self._client.run_on_scheduler(_withdraw, name=self._name)


def _offer(dask_scheduler: Any, name: str, contents: dict[str, bytes]) -> None:
    """Executed by the scheduler: hand out these contents."""
    offers = dask_scheduler.extensions.setdefault(_OPERATION, {})
    offers.setdefault(name, {}).update(contents)
    dask_scheduler.handlers[_OPERATION] = lambda name, digest: offers.get(name, {}).get(digest)


def _withdraw(dask_scheduler: Any, name: str) -> None:
    dask_scheduler.extensions[_OPERATION].pop(name, None)


_jobs: OrderedDict[str, Job] = OrderedDict()


def run_ticket(
    function: Callable[[Job, list[int]], list[Any]], ticket: Ticket, runs: list[int]
) -> tuple[list[Any], dict[str, bytes]]:
    """Execute runs in a worker; return what `function` does, and the traces to send back."""
    import distributed  # noqa: PLC0415 - optional: the extra `study`

    worker = distributed.get_worker()
    job = _job_of(ticket, worker)
    if ticket.traces is None or _is_here(ticket.traces / ticket.mark, ticket.offer):
        return function(job, runs), {}
    with tempfile.TemporaryDirectory(dir=worker.local_directory) as folder:
        found = function(replace(job, traces=Path(folder)), runs)
        return found, {path.name: path.read_bytes() for path in Path(folder).glob("*.mcap")}


def _is_here(mark: Path, content: str) -> bool:
    """Whether this process sees the folder of the one that wrote the mark."""
    try:
        return mark.read_text() == content
    except OSError:
        return False


def _job_of(ticket: Ticket, worker: Any) -> Job:
    """Return the job of a ticket, with its files here; it is asked for once."""
    from distributed.utils import sync  # noqa: PLC0415 - optional: the extra `study`

    if ticket.job not in _jobs:
        check_software(ticket.software)

        def fetch(digest: str) -> bytes:
            ask = getattr(worker.scheduler, _OPERATION)
            found: bytes | None = sync(worker.loop, ask, name=ticket.offer, digest=digest)
            if found is None:
                raise ComponentError(
                    "the scheduler does not have a file of the study any more",
                    where=f"worker {worker.address}",
                    got=f"nothing with SHA-256 {digest}",
                    hint="the same command continues",
                )
            return found

        job, shipment = pickle.loads(_verified(ticket.job, fetch))  # noqa: S301 - verified
        here = Path(tempfile.mkdtemp(prefix="study-", dir=worker.local_directory))
        job = replace(job, base=received(shipment, job.base, here, fetch))
        _jobs[ticket.job] = job
        while len(_jobs) > _JOBS_KEPT:
            _jobs.popitem(last=False)
    return _jobs[ticket.job]


def keep_traces(ticket: Ticket, traces: dict[str, bytes]) -> None:
    """Write traces that came back into the folder of the study.

    Raises
    ------
    OSError : they cannot be written.
    """
    for name, content in traces.items():
        assert ticket.traces is not None  # noqa: S101 - only then they come back
        write_whole(ticket.traces / name, content)
