"""Follow the first screen, the help and the pages to the letter, with what a wheel installs.

python -m tests.docs.literal_reader WHEEL                     # all of it: an hour
python -m tests.docs.literal_reader WHEEL --share 3/16        # the paths of new users, and a share
python -m tests.docs.literal_reader WHEEL docs/how-to/ci.md   # one page

The wheel is installed into a new environment as the README says, into an empty folder for each
page. Blocks are pasted into a shell as they stand; what a block reads, one before it has made.
Ends with 1 where a command fails, or prints something else than the page says.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # as pytest does, for the modules of tests

from docs.page_blocks import ROOT, Block, Reader, blocks_of, pages

from docs_site.help_examples import first_screen, followed, in_order, other_code

PATHS = (
    "README.md",
    "docs/tutorial/index.md",
    "docs/how-to/delay-systems.md",
    "docs/how-to/own-fmus.md",
    "docs/how-to/recorded-link.md",
    "docs/how-to/simulink.md",
)
"""Pages of new users: to begin; a loop of one's own; FMUs from elsewhere over a lossy link; a
vehicle and a modem's log; FMUs for Simulink."""
IN_A_CLONE = "in a clone"
"""The note above a block for who has the repository: here is the wheel alone."""
_LIMIT_S = 1500
_PYTHON = """\
import sys, traceback
names = {"__name__": "__main__"}
for line in sys.stdin:
    try:
        exec(compile(open(line.strip()).read(), line.strip(), "exec"), names)
        end = "done"
    except BaseException:
        traceback.print_exc(file=sys.stdout)
        end = "failed"
    print(f"\\n<<{end}>>", flush=True)
"""
"""Python as a page uses it: its blocks one after the other, in one namespace."""


@dataclass
class LiteralReader(Reader):
    """Who types what a page says, in an environment with the wheel and nothing else.

    environment : folder of the virtual environment; `wheel` : what is installed in it.
    """

    environment: Path = Path()
    wheel: Path = Path()
    interpreter: subprocess.Popen[str] | None = field(default=None, repr=False)

    def do(self, block: Block) -> None:
        """Do one block; those for a clone are passed over."""
        if block.note == IN_A_CLONE:
            self.output = ""
        elif block.language == "sh" and block.is_run:
            self.output = self.pasted(block.text)
        elif not (block.language == "text" and not self.output):
            super().do(block)

    def pasted(self, text: str, allowed: int = 0) -> str:
        """Paste lines into a shell; return what they print. AssertionError if one fails."""
        done = subprocess.run(  # noqa: S603 - what a page tells people to type
            ["bash", "-euo", "pipefail", "-c", text],  # noqa: S607 - as a reader has it
            cwd=self.folder,
            env=self._variables(),
            capture_output=True,
            text=True,
            check=False,
            timeout=_LIMIT_S,
        )
        assert done.returncode in (0, allowed), f"{text}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr, f"{text}\n{done.stderr}"
        return done.stdout + done.stderr

    def _run(self, block: Block) -> str:
        if self.interpreter is None:
            self.interpreter = subprocess.Popen(  # noqa: S603 - the same
                ["python", "-c", _PYTHON],  # noqa: S607 - of the environment
                cwd=self.folder,
                env=self._variables(),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
        assert self.interpreter.stdin is not None
        assert self.interpreter.stdout is not None
        file = self.folder / ".block.py"
        file.write_text(block.text, "utf-8")
        self.interpreter.stdin.write(f"{file}\n")
        self.interpreter.stdin.flush()
        printed: list[str] = []
        for line in self.interpreter.stdout:
            if line in ("<<done>>\n", "<<failed>>\n"):
                assert line == "<<done>>\n", "".join(printed)
                return "".join(printed)
            printed.append(line)
        raise AssertionError("Python has ended: " + "".join(printed))

    def close(self) -> None:
        """End Python, if it runs."""
        if self.interpreter is not None:
            self.interpreter.kill()
            self.interpreter.communicate()

    def _variables(self) -> dict[str, str]:
        kept = {
            k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL", "GIT"))
        }
        return kept | {
            "PATH": f"{self.environment / 'bin'}:/usr/local/bin:/usr/bin:/bin",
            "HOME": str(self.folder.parent),
            "COLUMNS": "200",
            "MPLBACKEND": "Agg",
            "PIP_CONSTRAINT": str(ROOT / "constraints.txt"),
            "PIP_DISABLE_PIP_VERSION_CHECK": "1",
            "PIP_QUIET": "1",
        }


def extras() -> str:
    """Return the extras that the README installs, in brackets."""
    found = re.search(r"any\.whl(\[[\w,]+\])", (ROOT / "README.md").read_text("utf-8"))
    assert found is not None, "the README does not say how to install the wheel"
    return found[1]


def install(wheel: Path, environment: Path) -> None:
    """Install a wheel with the extras that the README names, into an environment, or a new one."""
    if not environment.exists():
        subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)  # noqa: S603
    pip = [str(environment / "bin" / "python"), "-m", "pip", "install", "-qq"]
    pinned = ["--disable-pip-version-check", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, *pinned, f"{wheel}{extras()}"], check=True)  # noqa: S603 - our own wheel


def follow_page(page: Path, reader: LiteralReader) -> None:
    """Do every block of a page, in order; AssertionError names the line of the one that fails."""
    for block in blocks_of(page):
        try:
            reader.do(block)
        except Exception as error:
            raise AssertionError(f"{page.relative_to(ROOT)}:{block.line}: {error}") from error


def follow_lines(lines: list[str], reader: LiteralReader) -> None:
    """Type command lines one after the other, those that nobody can follow here left out."""
    for line in followed(reader.folder, lines):
        reader.pasted(line.replace(" --open", ""), other_code(line))


def errands(chosen: list[str], share: str) -> Iterator[tuple[str, Path | list[str]]]:
    """Yield what is followed: its name, and a page or command lines."""
    if chosen:
        yield from ((name, ROOT / name) for name in chosen)
        return
    yield "cosim alone", first_screen()
    yield from ((name, ROOT / name) for name in PATHS)
    number, of = map(int, share.split("/"))
    rest: list[tuple[str, Path | list[str]]] = [("every help example", in_order())]
    rest += [
        (str(page.relative_to(ROOT)), page)
        for page in pages()
        if str(page.relative_to(ROOT)) not in PATHS and any(b.is_run for b in blocks_of(page))
    ]
    yield from rest[number % of :: of]


def main() -> int:
    """Follow what the command line asks for; return the exit code."""
    parser = argparse.ArgumentParser(prog="tests.docs.literal_reader")
    parser.add_argument("wheel", type=Path)
    parser.add_argument("pages", nargs="*", help="pages of the repository; none: all")
    parser.add_argument("--share", default="0/1", help="I/N: the paths, and a share of the rest")
    parser.add_argument("--environment", type=Path, help="one with the wheel; none: a new one")
    asked = parser.parse_args()
    wheel, failed = asked.wheel.resolve(), 0
    with tempfile.TemporaryDirectory() as place:
        environment = asked.environment or Path(place) / "environment"
        install(wheel, environment)
        for number, (name, what) in enumerate(errands(asked.pages, asked.share)):
            folder = Path(place) / f"folder-{number}"
            folder.mkdir()
            shutil.copy(wheel, folder)
            reader = LiteralReader(folder, environment=environment, wheel=wheel)
            begun = time.monotonic()
            try:
                if isinstance(what, Path):
                    follow_page(what, reader)
                else:
                    follow_lines(what, reader)
            except (AssertionError, subprocess.TimeoutExpired) as error:
                failed += 1
                print(f"FAILED {name}\n{error}", flush=True)
            else:
                print(f"ok     {name} ({time.monotonic() - begun:.0f} s)", flush=True)
            finally:
                reader.close()
    print(f"{failed} failed")
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
