"""List the licences of all that pip installs with this package, from the metadata of what is installed here.

python docs/examples/licences.py docs/licences.md
"""

import re
import sys
import tomllib
from collections.abc import Iterable, Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = Path(__file__).parents[2] / "pyproject.toml"
# A longer text in `License` is the licence itself, and no name of one.
LONGEST = 60
# Extras that the list leaves out: what only developers and teachers install, and what a machine with a CUDA card needs.
OURS = ("dev", "gpu", "notebook", "test")
BEGIN, END = "<!-- made by docs/examples/licences.py -->", "<!-- end -->"


def direct() -> list[str]:
    """Return the names that this package and the extras of users ask for."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    extras = [lines for extra, lines in project["optional-dependencies"].items() if extra not in OURS]
    names = {named(text) for lines in (project["dependencies"], *extras) for text in lines}
    return sorted(names - {project["name"]})


def named(requirement: str) -> str:
    """Return the name of a requirement as the index spells it."""
    return re.sub(r"[-_.]+", "-", Requirement(requirement).name).lower()


def needed_by(package: Distribution) -> Iterator[str]:
    """Yield what a package asks for here, without extras."""
    for text in package.requires or ():
        marker = Requirement(text).marker
        if marker is None or marker.evaluate({"extra": ""}):
            yield named(text)


def all_of(names: Iterable[str]) -> dict[str, Distribution]:
    """Return the packages of these names, and all that they need, as far as they are installed."""
    found: dict[str, Distribution] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            continue
        waiting += needed_by(found[name])
    return dict(sorted(found.items()))


def licence_of(package: Distribution) -> str:
    """Return the licence: its SPDX expression, else its short name, else what the classifiers say."""
    about = package.metadata
    short = (about.get("License") or "").strip()
    kinds = [text.split(" :: ")[-1] for text in about.get_all("Classifier") or () if text.startswith("License ::")]
    named = short if 0 < len(short) <= LONGEST and "\n" not in short else ""
    return about.get("License-Expression") or named or ", ".join(kinds) or "not stated"


def table() -> str:
    """Return the table in Markdown."""
    own = set(direct())
    rows = [f"| {name} | {licence_of(one)} | {'yes' if name in own else ''} |" for name, one in all_of(own).items()]
    return "\n".join(
        [BEGIN, "| package | licence by its metadata | asked for by this one |", f"{'| --- ' * 3}|", *rows, END]
    )


def main(page: Path) -> None:
    """Put the table into a page, between its marks."""
    text = page.read_text(encoding="utf-8")
    before, after = text[: text.index(BEGIN)], text[text.index(END) + len(END) :]
    page.write_text(f"{before}{table()}{after}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
