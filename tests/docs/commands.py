"""The commands that the guide shows: every line of every block marked `sh`."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(sdm [^`]*)`")


def pages() -> list[Path]:
    """Return the pages at the top of the repository and in docs, without what Sphinx generates."""
    docs = ROOT / "docs"
    tutorials = sorted((docs / "tutorials").glob("*.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(docs.glob("*.md")), *tutorials]


def shown(page: Path) -> list[str]:
    """Return the commands of a page in their order, one for each part between `&&`, without comments."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    return [command for line in lines for command in parts(line)]


def parts(line: str) -> Iterator[str]:
    """Split a line at `&&`."""
    for part in line.split("&&"):
        words = shlex.split(part, comments=True)
        if words:
            yield shlex.join(words)


def mentioned(page: Path) -> list[list[str]]:
    """Return the words of commands within sentences and tables; brackets mark what may be left out."""
    found = INLINE.findall(page.read_text(encoding="utf-8"))
    return [re.sub(r"\\\||[\[\]|,;]|\.\.\.", " ", text).split() for text in found]
