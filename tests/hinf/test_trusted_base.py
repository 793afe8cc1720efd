"""What has to be right for a certificate to be believed: the code that its check loads."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

CERTIFICATES = Path(__file__).parents[1] / "corpus" / "certificates"
MOST = 2000
"""Lines of code, without comments and docstrings, of the rooms of proofs."""

SCRIPT = """
import json, sys
from cosim import hinf
assert hinf.check_certificate(json.load(open(sys.argv[1]))).valid
rooms = ("cosim.hinf.certificate.", "cosim.hinf.theorems.", "cosim.hinf.exact.")
print(json.dumps({x: sys.modules[x].__file__ for x in sys.modules if x.startswith("cosim.hinf.")}))
assert all(x.startswith(rooms) or x + "." in rooms for x in sys.modules if x[:11] == "cosim.hinf.")
"""


def lines_of_code(path: Path) -> int:
    """Lines that are neither empty, nor a comment, nor of a docstring."""
    text = path.read_text("utf-8")
    quoted = {
        line
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    lines = enumerate(map(str.strip, text.splitlines()), 1)
    return sum(bool(x) and not x.startswith("#") and i not in quoted for i, x in lines)


@pytest.mark.parametrize(
    "name", ["stability", "constant", "any", "sampled", "norm", "refutation", "gamma-floor"]
)
def test_the_code_that_a_check_trusts_is_small(name: str) -> None:
    """Of each kind, without guarantees beside gamma; no solver's room is loaded."""
    path = CERTIFICATES / f"{name}.json"
    command = [sys.executable, "-c", SCRIPT, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
    assert done.returncode == 0, done.stderr
    count = {x: lines_of_code(Path(file)) for x, file in json.loads(done.stdout).items()}
    assert 500 < sum(count.values()) < MOST, count
