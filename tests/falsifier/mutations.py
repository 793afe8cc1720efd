"""Mutations that claim too much: each is made in a copy of the tree, and something has to notice.

    python -m tests.falsifier.mutations [--name TEXT] [--together] [--tests] [--jobs N]

The falsifier flies its matrix over each mutated tree until a claim is wrong that was not wrong
without the mutation; with `--tests` what survives that goes through the tests of the guarantee too,
the slow ones as well.
Exit code 1: a mutation survived, or its text is not in the tree, so that it has to be written anew.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

if __package__ == "tests.falsifier":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from falsifier.claim_too_much import MUTATIONS, Mutation

ROOT = Path(__file__).resolve().parents[2]
TESTS = tuple(
    f"tests/scenario/test_{name}.py"
    for name in (
        *("guarantee", "loop_as_designed", "feedback_age", "assumptions"),
        *("plant_of_the_design", "design_order"),
    )
)
"""What a mutation goes through that the matrix lets pass."""


def main() -> int:
    """Run the command; 0 if no mutation survives."""
    parser = argparse.ArgumentParser(prog="python -m tests.falsifier.mutations")
    parser.add_argument("--name", default="", help="those whose name contains it")
    parser.add_argument("--together", action="store_true", help="all of them at once as well")
    parser.add_argument("--tests", action="store_true", help="the tests of the guarantee as well")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    chosen = [x for x in MUTATIONS if asked.name in x.name]
    survivors: list[str] = []
    with tempfile.TemporaryDirectory(prefix="mutations-") as scratch:
        field = Field(Path(scratch), asked.jobs, tests=asked.tests)
        with Progress(console=Console(stderr=True)) as progress:
            task = progress.add_task("the tree as it is", total=len(chosen) + asked.together + 1)
            field.fly_unmutated(_kinds(chosen))
            progress.advance(task)
            groups = [(x.name, [x]) for x in chosen]
            groups += [("all together", chosen)] if asked.together else []
            for name, group in groups:
                progress.update(task, description=name)
                noticed = field.noticed(group)
                console.print(f"{name}: {noticed or 'SURVIVES'}")
                survivors += [] if noticed else [name]
                progress.advance(task)
    console.print(f"{len(groups)} flown, {len(survivors)} survive")
    return int(bool(survivors))


class Field:
    """Copies of the tree, mutated and flown."""

    def __init__(self, scratch: Path, jobs: int, *, tests: bool) -> None:
        self._scratch, self._jobs, self._tests = scratch, jobs, tests
        self._known = scratch / "known.json"
        self._tree = scratch / "tree"
        self._copied()

    def _copied(self) -> None:
        """Copy the files under version control, as they are."""
        words = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        listed = subprocess.run(words, cwd=ROOT, check=True, capture_output=True)  # noqa: S603
        for name in filter(None, listed.stdout.decode().split("\0")):
            if (ROOT / name).is_file():
                target = self._tree / name
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(ROOT / name, target)

    def fly_unmutated(self, kinds: tuple[str, ...]) -> None:
        """Note which cells are wrong without a mutation, and which tests fail."""
        self._known.write_text("[]", "utf-8")
        wrong = [
            [x["kind"], x["hypothesis"], x["name"]] for x in self._answers(kinds, until_wrong=False)
        ]
        self._known.write_text(json.dumps(wrong), "utf-8")
        if self._tests and (failed := self._failed()):
            raise SystemExit(f"the tests fail without a mutation: {failed}")

    def noticed(self, mutations: list[Mutation]) -> str:
        """What notices mutations that are made together; empty if nothing does."""
        kept = {x.file: (self._tree / x.file).read_text("utf-8") for x in mutations}
        try:
            for each in mutations:
                path = self._tree / each.file
                if kept[each.file].count(each.old) != 1:
                    raise SystemExit(f"{each.name}: its text stands not once in {each.file}")
                # together, one before may have taken its text with it
                path.write_text(path.read_text("utf-8").replace(each.old, each.new), "utf-8")
            wrong = self._answers(_kinds(mutations), until_wrong=True)
            if wrong:
                first = wrong[0]
                return f"{first['kind']}: {first['name']}: {first['verdict']}"
            return self._failed() if self._tests else ""
        finally:
            for file, text in kept.items():
                (self._tree / file).write_text(text, "utf-8")

    def _answers(self, kinds: tuple[str, ...], *, until_wrong: bool) -> list[dict[str, str]]:
        words = ["-m", "tests.falsifier", "--json", "--cases", "0", "--claims", "--quick"]
        words += ["--jobs", str(self._jobs), "--parts", str(self._scratch / "parts")]
        words += ["--known", str(self._known), "--kind", *kinds]
        words += ["--until-wrong"] if until_wrong else []
        done = self._run(words)
        if done.returncode not in {0, 1} or not done.stdout:
            return [{"kind": "", "name": done.stderr[-200:].strip(), "verdict": "does not run"}]
        found: list[dict[str, str]] = json.loads(done.stdout)["wrong"]
        return found

    def _failed(self) -> str:
        every = ["-m", "slow or not slow"]
        done = self._run(["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *every, *TESTS])
        lines = [x for x in done.stdout.splitlines() if x.startswith(("FAILED", "ERROR"))]
        return "" if done.returncode == 0 else (lines or ["the tests do not run"])[0][:200]

    def _run(self, words: list[str]) -> subprocess.CompletedProcess[str]:
        own = {**os.environ, "PYTHONPATH": str(self._tree)}
        own.pop("SHARE", None)
        return subprocess.run(  # noqa: S603 - our own command
            [sys.executable, *words],
            cwd=self._tree,
            env=own,
            check=False,
            capture_output=True,
            text=True,
        )


def _kinds(mutations: list[Mutation]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(kind for x in mutations for kind in x.kinds))


if __name__ == "__main__":
    sys.exit(main())
