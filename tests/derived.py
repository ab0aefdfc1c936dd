"""What is written out of the schema of settings: the types of keywords, and the guide's table. Write them again by

python -m tests.derived
"""

from collections.abc import Iterable
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from sdm_deflect.base.schema import GROUPS, Range, Setting, choices_of
from sdm_deflect.cases.cli.options import settings_options
from sdm_deflect.cases.settings.job_settings import BY_NAME, IN_PYTHON

ROOT = Path(__file__).parents[1]
KEYWORDS, GUIDE = ROOT / "cases" / "settings" / "keywords.py", ROOT / "docs" / "settings.md"
HEAD = '''"""Settings of a deflection as typed keywords, generated from the schema by `python -m tests.derived`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from sdm_deflect.deform.box.automatic import BoxRule
    from sdm_deflect.deform.box.hexahedron import Hexahedron
    from sdm_deflect.deform.surface.motions import Motion
    from sdm_deflect.deform.surface.surface import NodeSet
    from sdm_deflect.deform.surface.tables import Table


class Options(TypedDict, total=False):
    """What `deflect`, `sweep` and `plan` take beside the mesh, the surfaces, the hinge and the angle."""

'''
ABOUT = """# Settings of a deflection

For those who look up a setting. Each has one name. In Python it is a keyword of `deflect`, `sweep` and `plan`; in a
file of settings it is a key. On the command line `--set NAME=VALUE` sets it, or its option. The settings of a surface,
the first table, stand in a table `[[surface]]` of a file.
"""


def source(kind: Any, spelled: bool) -> str:
    """Return the types that a keyword may have, as Python writes them."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return " | ".join(dict.fromkeys(source(part, spelled) for part in inner if part is not NoneType))
    if origin is Literal:
        return "Literal[" + ", ".join(f'"{word}"' for word in inner) + "]"
    if origin is dict:
        return "str | Sequence[str] | Mapping[str, str]"
    if origin is tuple:
        if is_dataclass(inner[0]):
            return "Mapping[str, Any] | Sequence[Any]" if spelled else "Sequence[Mapping[str, Any]]"
        return "str | Sequence[str]" if inner[0] is str else "ArrayLike"
    if kind.__name__ == "Table":
        return "Table | tuple[ArrayLike, ArrayLike]"
    if kind.__name__ == "Shapes":
        return "PathLike[str] | ArrayLike"
    return "str | PathLike[str]" if kind is str else kind.__name__


def keywords(settings: Iterable[Setting]) -> str:
    """Return the module with the types of keywords."""
    given = [one for one in settings if one.name not in (*IN_PYTHON, "hinge", "angle")]
    return HEAD + "".join(f"    {one.name}: {_typed(one)}\n" for one in given)


def _typed(setting: Setting) -> str:
    """Return the type of a keyword; text is a path only where it may name a file."""
    text = source(setting.kind, setting.spelling.read is not None)
    return text if setting.spelling.file is not None else text.replace("str | PathLike[str]", "str")


def row(setting: Setting) -> str:
    """Return what the guide says of a setting."""
    options = settings_options([setting])
    words, within = choices_of(setting.kind), setting.note(Range)
    values = ", ".join(f"`{word}`" for word in words) or (f"a number {within}" if within else "")
    shown = f"`{setting.default_text}`" if setting.default_text else ""
    option = f"`{options[0].opts[0]}`" if options else ""
    text = f"{setting.doc.text} {setting.doc.more}".rstrip().replace("|", "\\|")
    return f"| `{setting.name}` | {option} | {values} | {shown} | {text} |\n"


def guide(settings: Iterable[Setting]) -> str:
    """Return the page with the table of settings."""
    known, page = list(settings), ABOUT
    for group in GROUPS:
        rows = [row(one) for one in known if one.doc.text and one.doc.group == group]
        head = "| setting | option | values | default | meaning |\n| --- | --- | --- | --- | --- |\n"
        page += f"\n## {group}\n\n{head}{''.join(rows)}"
    return page


if __name__ == "__main__":
    KEYWORDS.write_text(keywords(BY_NAME.values()), encoding="utf-8")
    GUIDE.write_text(guide(BY_NAME.values()), encoding="utf-8")
