"""From what the user typed to a case."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sdm_deflect.cases.case import Case
from sdm_deflect.cases.confine import hexahedron_of
from sdm_deflect.cases.errors import InputError
from sdm_deflect.cases.overrides import Nested, parse_assignments, read_toml, with_overrides
from sdm_deflect.cases.registry import case_named
from sdm_deflect.cases.zero_sites import block_stations


def resolve(
    name: str,
    scale: str = "small",
    angle: float | None = None,
    strategy: str | None = None,
    assignments: Sequence[str] = (),
    config: Path | None = None,
) -> Case:
    """Return the case: registered defaults, then the configuration file, then options, then --set.

    Raises
    ------
    InputError
        One sentence: what is wrong, which value, what would be right.
    """
    try:
        tables: Nested = read_toml(config) if config else {}
        name = name or str(tables.get("name", ""))
        if not name:
            raise ValueError("no case given; name one (see sdm list) or give --config case.toml")
        case = with_overrides(case_named(name, str(tables.get("scale", scale))), tables)
        if angle is not None:
            case = replace(case, angle=angle)
        if strategy is not None:
            case = replace(case, strategy=strategy)  # type: ignore[arg-type]
        case = with_overrides(case, parse_assignments(assignments))
        for one in case.deflections:
            block_stations(case, one.surface)
            hexahedron_of(case, one.surface)
    except (ValueError, TypeError) as error:
        raise InputError(str(error)) from error
    return case
