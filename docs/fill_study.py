"""Put the result of ``bev-bench study`` into its page: ``python docs/fill_study.py FOLDER``."""

from __future__ import annotations

import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).parent
BEGIN, END = "<!-- study: begin -->", "<!-- study: end -->"


def filled(page: str, result: str) -> str:
    """The page with a result, whose headings go down a level, between its marks."""
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(f"the page has no {BEGIN} and {END}")
    body = re.sub(r"^# .*\n+", "", result)
    body = re.sub(r"^##", "###", body, flags=re.MULTILINE).strip()
    picture = "![Mean IoU against driving, and the correlation of each metric](study/study.png)"
    table = "All figures: [study/study.csv](study/study.csv)."
    return f"{before}{BEGIN}\n{body}\n\n{picture}\n\n{table}\n{END}{after}"


def main(folder: Path) -> None:
    """Fill the page and copy table and figure beside it."""
    page = DOCS / "study.md"
    text = filled(page.read_text("utf-8"), (folder / "study.md").read_text("utf-8"))
    (DOCS / "study").mkdir(exist_ok=True)
    for name in ("study.csv", "study.png"):
        shutil.copyfile(folder / name, DOCS / "study" / name)
    page.write_text(text, "utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
