"""The commands that the guide shows: every line of every block marked `sh`.

python3 -m tests.docs.commands PAGE TEXT

prints the first line of a page's blocks that has the text in it, lines that are continued joined to one.
"""

import re
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"`(sdm [^`]*)`")
CONTINUED = re.compile(r"\s*\\\n\s*")


def pages() -> list[Path]:
    """Return the pages at the top of the repository and in docs, without what Sphinx generates."""
    docs = ROOT / "docs"
    tutorials = sorted((docs / "tutorials").glob("*.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted(docs.glob("*.md")), *tutorials]


def lines_of(page: Path) -> list[str]:
    """Return the lines of a page's blocks, those that end with a backslash joined to what follows."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [line for block in blocks for line in CONTINUED.sub(" ", block).splitlines()]


def line_with(page: Path, text: str) -> str:
    """Return the first line of a page's blocks that has a text in it."""
    return next(line for line in lines_of(page) if text in line)


def shown(page: Path) -> list[str]:
    """Return the commands of a page in their order, one for each part between `&&`, without comments."""
    return [command for line in lines_of(page) for command in parts(line)]


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


if __name__ == "__main__":
    sys.stdout.write(f"{line_with(Path(sys.argv[1]), sys.argv[2])}\n")
