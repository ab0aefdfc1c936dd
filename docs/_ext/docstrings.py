"""Docstrings of the source in the form that Sphinx reads.

What follows `name : ` is a description and no type, and formulas in plain text hold no markup.
"""

import re
from typing import Any

from sphinx.application import Sphinx

SECTIONS = ("Attributes", "Parameters", "Returns")
ENTRY = re.compile(r"(\s*)(\w[\w, ]*) : (.+)")
MARKUP = re.compile(r"([|*]|(?<=\w)_(?!\w))")
CODE = re.compile(r"(`[^`]*`)")
BEFORE_NAPOLEON = 400


def rewritten(lines: list[str]) -> list[str]:
    """Put the text after the colon of an entry on a line of its own, as the beginning of its description."""
    out: list[str] = []
    inside = False
    for i, line in enumerate(lines):
        following = lines[i + 1] if i + 1 < len(lines) else ""
        if following.strip() and set(following.strip()) == {"-"}:
            inside = line.strip() in SECTIONS
        entry = ENTRY.fullmatch(line) if inside else None
        if entry is None or entry[1]:
            out.append(line)
        else:
            closed = "." if following.startswith("    ") and following.strip()[:1].isupper() else ""
            out += [entry[2], f"    {entry[3].rstrip('.') + '.' if closed else entry[3]}"]
    return out


def escaped(line: str) -> str:
    """Escape bars, stars and trailing underscores outside of backticks; a bullet stays."""
    start = len(line) - len(line.lstrip(" *" if line.lstrip().startswith("* ") else " "))
    parts = CODE.split(line[start:])
    return line[:start] + "".join(part if part.startswith("`") else MARKUP.sub(r"\\\1", part) for part in parts)


def process(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Rewrite the lines of a docstring in place."""
    lines[:] = [escaped(line) for line in rewritten(lines)]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc, ahead of napoleon."""
    app.connect("autodoc-process-docstring", process, priority=BEFORE_NAPOLEON)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
