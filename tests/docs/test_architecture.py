"""The map of the code is true: its rooms and files exist, and a deflection enters the files that it names."""

import inspect
import re
import sys
from pathlib import Path

from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.deform.blocks import block_with_body

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
FOLLOWED = PAGE.partition("## One deflection, followed")[2].partition("\n## ")[0]
# Files of that part that a mesh without a spoiled cell does not enter.
OTHERS = ("cases/aircraft/", "repair/repair.py")


def rows(text: str) -> list[str]:
    """The first cell of each row of the tables in a text."""
    return [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]


def files_in(text: str) -> list[str]:
    """The files that a text names."""
    return re.findall(r"`([a-z_/]+/[a-z_]+\.py)`", text)


def test_every_file_of_the_page_is_there():
    assert [name for name in files_in(PAGE) if not (ROOT / name).is_file()] == []


def test_every_room_is_on_the_map_and_is_there():
    named = {name for cell in rows(PAGE.partition("## One deflection")[0]) for name in re.findall(r"`([\w.]+)`", cell)}
    places = {name: (ROOT if "." in name else ROOT / "sdm_deflect") / name.replace(".", "/") for name in named}
    assert [name for name, place in places.items() if not (place.is_dir() or place.with_suffix(".py").is_file())] == []
    folders = {
        f"{top}.{folder.name}"
        for top in ("cases", "deform", "meshing")
        for folder in (ROOT / top).iterdir()
        if (folder / "__init__.py").is_file()
    }
    assert folders - named == set()


def test_a_deflection_enters_the_files_that_the_page_follows(tmp_path, monkeypatch):
    entered: set[str] = set()

    def entering(frame, event, _):
        if event == "call" and frame.f_code.co_flags & inspect.CO_OPTIMIZED:  # a function, no body of a module or class
            entered.add(frame.f_code.co_filename)

    FORMATS["su2"].write(block_with_body(), tmp_path / "block.su2")
    monkeypatch.chdir(tmp_path)
    words = ["deflect", "block.su2", "--surface", "body", "--hinge", "0,-1,0", "0,1,0", "--angle", "5"]
    sys.setprofile(entering)
    try:
        code = cli([*words, "--no-report", "-q"], standalone_mode=False)
    finally:
        sys.setprofile(None)
    assert code == 0
    known = {str(Path(name).resolve()) for name in entered}
    followed = [name for cell in rows(FOLLOWED) for name in files_in(cell) if not any(part in name for part in OTHERS)]
    assert len(followed) > 8
    assert [name for name in followed if str(ROOT / name) not in known] == []
