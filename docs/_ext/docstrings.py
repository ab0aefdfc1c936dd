"""Docstrings of the source in the form that Sphinx reads.

What follows `name : ` is a description and no type, and formulas in plain text hold no markup. A public name is
described under its public path alone, and fields of named tuples without the words that Python gives them.
"""

import re
from typing import Any

from sphinx.application import Sphinx
from sphinx.domains.python import PyObject

import sdm_deflect

SECTIONS = ("Attributes", "Parameters", "Raises", "Returns")
ENTRY = re.compile(r"(\s*)([\w*][\w*, ]*) : (.+)")
MARKUP = re.compile(r"([|*]|(?<=\w)_(?!\w))")
CODE = re.compile(r"(``.+?``|`[^`]*`)")
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
    """Rewrite the lines of a docstring in place; of an attribute, no words before a colon are a type."""
    lines[:] = [escaped(line) for line in rewritten(lines)]
    if what in ("attribute", "data", "property") and ":" in lines[0]:
        lines[0] = f": {lines[0]}"


def is_elsewhere(app: Sphinx, what: str, name: str, thing: Any, skip: bool, options: Any) -> bool | None:
    """Skip what the page of public names describes, what comes from matplotlib, and fields of which nothing is said."""
    if what == "module" and name in sdm_deflect.__all__ and thing is getattr(sdm_deflect, name):
        return True
    if (getattr(thing, "__module__", None) or "").startswith("matplotlib"):
        return True
    return (getattr(thing, "__doc__", None) or "").startswith("Alias for field number") or None


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect to autodoc, ahead of napoleon; attributes within a docstring are no links."""
    app.connect("autodoc-process-docstring", process, priority=BEFORE_NAPOLEON)
    app.connect("autodoc-skip-member", is_elsewhere)
    for kind in PyObject.doc_field_types:
        kind.rolename = "" if kind.name == "variable" else kind.rolename
    return {"parallel_read_safe": True, "parallel_write_safe": True}
