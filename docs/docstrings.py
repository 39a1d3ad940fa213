"""Griffe extension: docstrings as Markdown, so that the API reference shows them as they are meant.

Doctests stand in docstrings without a heading, and references are Sphinx's.
"""

from __future__ import annotations

import re
from typing import Any

import griffe

EXAMPLE = re.compile(r"(?:^>>> .*\n?)(?:^(?!\s*$).*\n?)*", re.MULTILINE)
"""A prompt and all that follows up to an empty line."""
ROLE = re.compile(r":(?:func|class|meth|attr|mod):(?=`)")


class MarkdownDocstrings(griffe.Extension):
    """Fences doctests and drops Sphinx's roles."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite the docstring of one object."""
        if obj.docstring is not None:
            obj.docstring.value = as_markdown(obj.docstring.value)


def as_markdown(text: str) -> str:
    """Fence doctests and drop Sphinx's roles.

    >>> as_markdown("See :func:`f`.")
    'See `f`.'
    """
    fenced = EXAMPLE.sub(lambda match: f"```pycon\n{match[0].rstrip()}\n```\n", text)
    return ROLE.sub("", fenced)
