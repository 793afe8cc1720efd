"""Convert Markdown to HTML; a fenced block of language `math` is LaTeX and becomes MathML."""

from __future__ import annotations

import html
import re
import unicodedata
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from markdown_it.renderer import RendererProtocol
    from markdown_it.token import Token


def to_html(markdown: str) -> str:
    """Convert a component's text to HTML; browsers show its equations offline."""
    from markdown_it import MarkdownIt  # noqa: PLC0415 - a run writes no pages

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    parser.add_render_rule("fence", _fence)
    return str(parser.render(markdown))


def block(code: str, language: str) -> str:
    """Return HTML of a block of program text."""
    return f'<pre><code class="language-{language}">{html.escape(code)}</code></pre>\n'


def _fence(
    renderer: RendererProtocol, tokens: Sequence[Token], index: int, options: Any, env: Any
) -> str:
    del renderer, options, env
    token = tokens[index]
    if token.info.strip() != "math":
        return block(token.content, token.info.strip() or "text")
    return f'<div class="equation">{_mathml(token.content.strip())}</div>\n'


def _mathml(latex: str) -> str:
    """Convert LaTeX to MathML that is readable without a mathematical font.

    Without one, brackets do not grow and dots are misplaced: a matrix gets its brackets from the
    style sheet, a dotted letter its dot from the letter's own font.
    """
    from latex2mathml.converter import convert  # noqa: PLC0415 - a run writes no pages

    found = convert(latex, display="block")
    found = re.sub(r"<mo>&#x0005B;</mo><mtable>", '<mtable class="matrix">', found)
    found = re.sub(r"</mtable><mo>&#x0005D;</mo>", "</mtable>", found)
    return re.sub(
        r"<mover>(?:<mrow>)?<mi>([^<]+)</mi>(?:</mrow>)?<mo>&#x002D9;</mo></mover>",
        lambda match: f"<mi>{_italic(html.unescape(match[1]))}\u0307</mi>",
        found,
    )


def _italic(letter: str) -> str:
    """Return the letter of the mathematical italic alphabet; browsers slant single letters only."""
    kind = "GREEK SMALL LETTER " if letter > "z" else "LATIN SMALL LETTER "
    name = unicodedata.name(letter).removeprefix(kind)
    return unicodedata.lookup(f"MATHEMATICAL ITALIC SMALL {name}")
