"""What a benchmark yields: named figures, for people and for programs."""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class Result:
    """One figure."""

    name: str
    value: float
    unit: str
    median_of: int
    note: str = ""


def show(title: str, results: Iterable[Result]) -> None:
    """Print a table."""
    table = Table("figure", "value", "unit", "median of", "", title=title, title_justify="left")
    for r in results:
        table.add_row(r.name, f"{r.value:.4g}", r.unit, str(r.median_of), r.note)
    Console(width=120).print(table)


def write(path: Path, results: Iterable[Result]) -> None:
    """Write {name: {value, unit, median_of, note}} beside the place and rename it there."""
    content = {r.name: {k: v for k, v in asdict(r).items() if k != "name"} for r in results}
    draft = path.with_name(path.name + ".part")
    draft.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    draft.replace(path)


def markdown(title: str, results: Iterable[Result]) -> str:
    """Return a section with a table, as in `README.md`."""
    rows = [f"| `{r.name}` | {r.value:.4g} | {r.unit} | {r.median_of} | {r.note} |" for r in results]
    return "\n".join([f"## {title}", "", "| figure | value | unit | median of | |", "| --- " * 5 + "|", *rows, ""])
