"""Values in texts of a scenario: a quantity, `"50 ms"`, or an expression, `"2 * pi / 10 s"`."""

from __future__ import annotations

import re

from cosim.core import (
    NUMBER,
    NUMBER_ONLY,
    UNIT,
    Dimension,
    Quantity,
    QuantityError,
    check_dimension,
    parse_quantity,
)
from cosim.scenario.binding import formula
from cosim.scenario.expression import ExpressionError

VALUE_PATTERN = rf"^\s*{NUMBER}\s*{UNIT}\s*$|\(|\s[-+*/]\s|\*\*"
"""Regular expression of texts that may be a value: editors check by it."""
_EXPRESSION = re.compile(r"\(|\s[-+*/]\s|\*\*")


def parse_value(text: str) -> Quantity:
    """Parse a quantity, or an expression of numbers with units: its value in SI, its dimension.

    Operators have blanks around them, unless there are parentheses or a power: `1/s` is a unit.

    Raises
    ------
    QuantityError : neither; of an expression, with the column.
    """
    try:
        return parse_quantity(text)
    except QuantityError:
        if not _EXPRESSION.search(text):
            raise
    try:
        bound = formula(text)
        value = bound.number()
    except ExpressionError as error:
        more = f" ({error.expected})" if error.expected else ""
        raise QuantityError(
            f"an expression; of {text!r}, {error.where}: {error.what}{more}"
        ) from error
    return Quantity(value, bound.node.dimension or NUMBER_ONLY, text.strip())


def value_in(text: str, wanted: Dimension) -> float:
    """Parse a value of the dimension `wanted` and return it in SI; see `check_dimension`."""
    found = parse_value(text)
    check_dimension(found, wanted)
    return found.si
