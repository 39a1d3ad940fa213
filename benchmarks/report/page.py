"""HTML without a template language: elements as text, escaped where they hold data."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterable, Sequence
from pathlib import Path

HERE = Path(__file__).parent
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Browsers refuse to fetch anything for the page, whatever it holds."""


class Markup(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


Content = str | Markup | Iterable["Content"] | None


def element(tag: str, *content: Content, **attributes: str | int | None) -> Markup:
    """An element; strings in it are escaped, unless they are markup.

    Args:
        tag: Its name.
        content: Text, elements, lists of these; None is nothing.
        attributes: By name; a trailing underscore is dropped and others become hyphens, None
            leaves the attribute out.

    >>> element("td", "a < b", class_="left")
    '<td class="left">a &lt; b</td>'
    """
    names = {name.rstrip("_").replace("_", "-"): value for name, value in attributes.items()}
    written = "".join(
        f' {name}="{html.escape(str(value), quote=True)}"'
        for name, value in names.items()
        if value is not None
    )
    return Markup(f"<{tag}{written}>{text_of(content)}</{tag}>")


def void(tag: str, **attributes: str | int | None) -> Markup:
    """An element without content, such as an image."""
    return Markup(element(tag, **attributes).removesuffix(f"</{tag}>"))


def text_of(content: Content) -> str:
    """Content as HTML."""
    if content is None:
        return ""
    if isinstance(content, Markup):
        return str(content)
    if isinstance(content, str):
        return html.escape(content, quote=False)
    return "".join(text_of(part) for part in content)


def breakable(name: str) -> Markup:
    """A name that may be broken after its marks where a line is too short.

    >>> breakable("cvt_kde")
    'cvt_<wbr>kde'
    """
    return Markup(re.sub(r"([_~=@|,/])", r"\1<wbr>", text_of(name)))


def image(content: bytes, kind: str, description: str, **attributes: str | int | None) -> Markup:
    """An image that is part of the page.

    Args:
        content: Of its file.
        kind: ``"png"``, ``"jpeg"``, ``"webp"`` or ``"gif"``.
        description: What it shows, for those who cannot see it.
        attributes: As for :func:`element`.
    """
    source = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
    return void("img", src=source, alt=description, **attributes)


def figure(picture: Content, caption: Content) -> Markup:
    """A picture with a caption."""
    return element("figure", picture, element("figcaption", caption))


def section(title: str, *content: Content, name: str) -> Markup:
    """A section with a heading that can be linked to."""
    return element("section", element("h2", title, id=f"{name}-title"), *content, id=name)


def page(title: str, summary: Content, sections: Sequence[tuple[str, str, Content]]) -> str:
    """A whole document.

    Args:
        title: Of the page.
        summary: Below the title.
        sections: Name, title and content of each; the navigation lists them.
    """
    links = [element("li", element("a", heading, href=f"#{name}")) for name, heading, _ in sections]
    head = element(
        "head",
        void("meta", charset="utf-8"),
        void("meta", name="viewport", content="width=device-width, initial-scale=1"),
        void("meta", http_equiv="Content-Security-Policy", content=POLICY),
        void("link", rel="icon", href="data:,"),
        element("title", title),
        element("style", Markup((HERE / "style.css").read_text(encoding="utf-8"))),
    )
    body = element(
        "body",
        element("a", "To the results", href="#main", class_="skip"),
        element("header", element("h1", title), summary),
        element("nav", element("ul", links), aria_label="Sections"),
        element(
            "main",
            [section(heading, content, name=name) for name, heading, content in sections],
            id="main",
            tabindex=-1,  # so that the skip link takes the focus along
        ),
        element("script", Markup((HERE / "film.js").read_text(encoding="utf-8"))),
    )
    return f"<!doctype html>\n{element('html', head, body, lang='en')}\n"
