"""MkDocs hooks: the README is the site's first page, and links work here as they do on GitHub.

Pages are written for GitHub, where links lead through the repository. Here the pages of ``docs``
lie at the top; whatever else of the repository a page links to is put under ``repository/``.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).parent.parent
LINK = re.compile(r"(\]\()([^)\s#:]+)(#[^)\s]*)?(\))")
"""``](target#anchor)`` within the repository: a target with a colon leads elsewhere."""
FENCE = re.compile(r"(^```.*?^```$)", re.MULTILINE | re.DOTALL)


def on_files(files: Any, config: Any) -> Any:
    """Add the README, and what pages link to outside of ``docs``."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    files.append(File.generated(config, "index.md", content=readme))
    for page in [file for file in files if file.is_documentation_page()]:
        for target in links(page.content_string):
            path = in_repository(page.src_uri, target)
            uri = in_site(path)
            if files.get_file_from_path(uri) is None and (ROOT / path).is_file():
                files.append(File.generated(config, uri, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links through the repository into links through the site."""
    here = page.file.src_uri

    def moved(match: re.Match[str]) -> str:
        uri = in_site(in_repository(here, match[2]))
        target = posixpath.relpath(uri, posixpath.dirname(here) or ".")
        return f"{match[1]}{target}{match[3] or ''}{match[4]}"

    parts = FENCE.split(markdown)
    return "".join(part if part.startswith("```") else LINK.sub(moved, part) for part in parts)


def links(markdown: str) -> list[str]:
    """Targets of the links that lead through the repository, without their anchors.

    >>> links("[a](docs/a.md#b) [c](https://c.org) [d](../d.py)")
    ['docs/a.md', '../d.py']
    """
    return [
        match[2]
        for part in FENCE.split(markdown)
        if not part.startswith("```")
        for match in LINK.finditer(part)
    ]


def in_repository(page: str, target: str) -> str:
    """Where a link of a page leads in the repository.

    >>> in_repository("index.md", "docs/traffic.md"), in_repository("traffic.md", "../README.md")
    ('docs/traffic.md', 'README.md')
    """
    folder = "" if page == "index.md" else posixpath.dirname(f"docs/{page}")
    return posixpath.normpath(posixpath.join(folder, target))


def in_site(path: str) -> str:
    """Where a file of the repository lies on the site.

    >>> in_site("docs/pictures/a.png"), in_site("README.md"), in_site("examples/ppo.py")
    ('pictures/a.png', 'index.md', 'repository/examples/ppo.py')
    """
    if path == "README.md":
        return "index.md"
    return path[len("docs/") :] if path.startswith("docs/") else f"repository/{path}"
