"""HTML and SVG put together from elements. Text is escaped unless an element made it: names come from users."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Final


class Html(str):
    """Markup, already escaped. Only `element`, `joined` and `trusted` make one."""

    __slots__ = ()


Content = str | Iterable["Content"]
"""Text, markup, or several of them one after another."""

_VOID: Final = frozenset({"br", "hr", "meta"})


def element(name: str, /, *content: Content, **attributes: str | float | None) -> Html:
    """Return an element. An attribute's name is written with _ for -, or with a _ behind a word Python keeps.

    An attribute that is None is left out.
    """
    written = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{html.escape(_text(value))}"'
        for key, value in attributes.items()
        if value is not None
    )
    return Html(f"<{name}{written}>" + ("" if name in _VOID else f"{joined(content)}</{name}>"))


def joined(content: Content) -> Html:
    """Return contents one after another."""
    if isinstance(content, Html):
        return content
    if isinstance(content, str):
        return Html(html.escape(content))
    return Html("".join(joined(part) for part in content))


def trusted(markup: str) -> Html:
    """Return markup that this program itself has written."""
    return Html(markup)


def table(head: Iterable[Content], rows: Iterable[Iterable[Content]], **attributes: str | float | None) -> Html:
    """Return a table that scrolls sideways where it is too wide. A cell that begins like a number stands right."""
    return element(
        "div",
        element(
            "table",
            element("thead", element("tr", [element("th", cell, scope="col") for cell in head])),
            element("tbody", [element("tr", [_cell(cell) for cell in row]) for row in rows]),
            **attributes,
        ),
        class_="scroll",
    )


def _cell(content: Content) -> Html:
    number = isinstance(content, str) and content[:1] in "+-–0123456789" and content != ""
    return element("td", content, class_="number" if number else None)


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"
