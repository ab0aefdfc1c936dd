"""Every message that the program may end with, read from its source: `pytest -s tests/test_messages.py` prints them."""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.docs.prose import faults

ROOT = Path(__file__).parents[1]
PACKAGES = ("cases", "deform", "geometry", "meshing")
ERRORS = ("InputError", "MeshFileError", "WriteError", "OutputError", "ClickException", "UsageError", "LostError")


def messages() -> Iterator[tuple[str, str]]:
    """Yield where each message is raised, and its text with a word for each value."""
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            named = isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in ERRORS
            if named and node.args and (text := _text(node.args[0])):
                yield f"{path.relative_to(ROOT)}:{node.lineno}", text


def _text(node: ast.expr) -> str:
    if isinstance(node, ast.Constant):
        return str(node.value)
    values = node.values if isinstance(node, ast.JoinedStr) else []
    return "".join(str(one.value) if isinstance(one, ast.Constant) else "X" for one in values)


def test_messages_are_short_and_in_plain_words():
    found = list(messages())
    sys.stdout.write("".join(f"\n{text}   [{place}]" for place, text in found))
    assert len(found) > 300
    wrong = {f"{place}: {one}" for place, text in found for one in faults(f"{text.replace('`', '')}.")}
    assert wrong == set()
