"""Parse expressions: `plant.eta.z > 5 m and t > 10 s`, `2 m * sin(0.1 rad/s * t)`.

One language for all that a scenario or a study computes. Names are `component.variable` as in FMI,
with indices (`plant.x[1]`, `controller.K[1,3]`), quoted where Python could not read them
(`'sea-2.der(x)' > 1`); `t` is the time, `x` the value of a study's axis, `pi` and `e` are numbers.
Numbers may have a unit. Arithmetic, comparison, and, or, not, and the functions of
`cosim.scenario.functions`; nothing else.

The text is parsed by Python's `ast` and never executed; `cosim.scenario.binding` turns the tree
into a function.
"""

from __future__ import annotations

import ast
import re
import threading
import warnings
from typing import Any, Final

from cosim.core import NUMBER, InputError, Quantity, QuantityError, parse_quantity

MAX_LENGTH = 1000
_NAME = r"(?:[A-Za-zµμΩ°]+|%)"
_FACTOR = rf"{_NAME}(?:(?:\^|\*\*)-?\d|\d)?"
_WORDS = r"(?!(?:and|or|not|in|is|if|else|t|x|pi|e)\b)"
_TOKENS = re.compile(
    r"(?P<quoted>'[^'\n]*'|\"[^\"\n]*\")"
    r"|(?P<based>0[xXoObB]\w+)"
    r"|(?P<name>[A-Za-z_]\w*)"
    rf"|(?P<quantity>{NUMBER.removeprefix('[-+]?')}\s*{_WORDS}"
    rf"{_FACTOR}(?:[*/.·]{_WORDS}{_FACTOR})*)(?![\w.(\[])"
    rf"|(?P<number>{NUMBER.removeprefix('[-+]?')})"
)
_filters_guard = threading.Lock()
_FIRST = 0x4E00
"""First of the letters that replace quantities while Python parses: one letter each."""


class ExpressionError(InputError):
    """A text that is not an expression, or has no value; `column` of the fault, from 1."""

    def __init__(
        self,
        what: str,
        text: str,
        column: int,
        expected: str | None = None,
        hint: str | None = None,
    ) -> None:
        self.column = column
        self._text = text
        marked_text = f"{text}\n       {' ' * (column - 1)}^" if "\n" not in text else text
        super().__init__(
            what, where=f"column {column}", expected=expected, got=marked_text, hint=hint
        )

    def __reduce__(self) -> tuple[Any, ...]:
        again = (type(self), (self.what, self._text, self.column, self.expected))
        return (*again, {"where": self.where, "hint": self.hint})


class Expression:
    """A parsed condition or number: its form is right, its names are not known yet.

    Attributes
    ----------
    text : as written.
    tree : Python's syntax tree of the text, with a letter in place of each quantity.
    quantities : by that letter.

    Raises
    ------
    ExpressionError : not an expression; says the column.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self.quantities: dict[str, Quantity] = {}
        if not text.strip():
            raise ExpressionError("there is no condition", text, 1, "as in plant.eta.z > 5 m")
        if len(text) > MAX_LENGTH:
            raise ExpressionError(
                "the expression is too long", text[:60], 1, f"{MAX_LENGTH} letters"
            )
        readable = self._plain(text)
        self._readable = readable.lstrip()  # Python takes blanks in front for an indentation
        self._front = len(readable) - len(self._readable)
        self.tree = self._parsed()

    def column(self, node: ast.AST) -> int:
        """Return the column of a part of the tree in the text, from 1."""
        offset, line = getattr(node, "col_offset", 0), getattr(node, "lineno", 1)
        lines = self._readable.splitlines(keepends=True)
        before = lines[line - 1].encode()[:offset].decode("utf-8", "ignore") if lines else ""
        return self._front + sum(map(len, lines[: line - 1])) + len(before) + 1

    def wrong(self, node: ast.AST, what: str, expected: str | None = None) -> ExpressionError:
        """Return the error about a part of the tree."""
        return ExpressionError(what, self.text, self.column(node), expected)

    def _plain(self, text: str) -> str:
        """Return the text as Python can read it, every column where it was."""

        def plain(found: re.Match[str]) -> str:
            if found.lastgroup != "quantity":
                return found[0]
            letter = chr(_FIRST + len(self.quantities))
            try:
                self.quantities[letter] = parse_quantity(found[0])
            except QuantityError as error:
                raise ExpressionError(
                    f"{found[0]!r} is not a quantity", text, found.start() + 1, str(error)
                ) from error
            return letter.ljust(len(found[0]))

        without_quotes = re.sub(r"'[^'\n]*'|\"[^\"\n]*\"", "", text)
        odd = next((c for c in without_quotes if not (c.isascii() or c in "µμΩ°·")), None)
        if odd is not None or "\0" in text:
            at = text.find(odd) + 1 if odd else 1
            message = "an expression cannot contain this character"
            raise ExpressionError(message, text, at, "ASCII")
        return _TOKENS.sub(plain, text)

    def _parsed(self) -> ast.expr:
        try:
            # the filters are the process's: two threads would put each other's back
            with _filters_guard, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self._readable, mode="eval").body
        except SyntaxError as error:
            column = min(self._front + max(error.offset or 1, 1), len(self.text))
            raise ExpressionError(
                f"the expression cannot be understood: {error.msg}",
                self.text,
                column,
                "as in plant.eta.z > 5 m and t > 10 s",
                _hint(self.text),
            ) from error
        except (ValueError, RecursionError, MemoryError) as error:
            raise ExpressionError("the expression cannot be understood", self.text, 1) from error


_OTHER_LANGUAGES: Final = {
    "&&": "and in place of &&",
    "||": "or in place of ||",
    "!": "not in place of !",
    "=": "== in place of =, or better < and >: numbers of a run are rarely equal",
    "$": "a name without $",
}
"""Signs of other languages -> what is written here."""


def _hint(text: str) -> str:
    """Return what to do about a text that is no expression."""
    bare = re.sub(r"[<>=!]=", "", text)
    found = (words for sign, words in _OTHER_LANGUAGES.items() if sign in bare)
    return next(found, "two values and a comparison between them, joined by and, or, not")


def reference_of(node: ast.expr) -> str | None:
    """Return the `component.variable` that a part of the tree names; None if it names none."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.Name):
        return node.id
    if not isinstance(node, ast.Attribute | ast.Subscript):
        return None
    before = reference_of(node.value) if not isinstance(node.value, ast.Constant) else None
    if isinstance(node, ast.Attribute):
        return None if before is None else f"{before}.{node.attr}"
    places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
    numbers = [p.value for p in places if isinstance(p, ast.Constant)]
    whole = len(numbers) == len(places) and all(type(n) is int for n in numbers)
    return f"{before}[{','.join(map(str, numbers))}]" if before and whole else None
