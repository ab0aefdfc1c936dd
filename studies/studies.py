"""The studies by name: each writes its files into a folder and says in few lines what came of it."""

from pathlib import Path

from sdm_deflect.cases.run.progress import Stopwatch
from studies import centres_page, verdicts
from studies.files import verdicts as trends_of
from studies.files import write_study
from studies.measure import run_study
from studies.page import read_page, write_again, write_page
from studies.reasons import measure_reasons
from studies.stored import REASONS, write_json


def table(name: str, scale: str, folder: Path, watch: Stopwatch, cache: bool) -> str:
    """Write <name>.csv, <name>.md and <name>.png; return the verdicts."""
    result = run_study(name, scale, watch, cache)
    write_study(result, folder)
    return "\n".join(trends_of(result))


def reasons(scale: str, folder: Path, watch: Stopwatch, cache: bool) -> str:
    """Write tables/reasons.json and figures/centres.png; return what was measured, in a line."""
    for name in ("tables", "figures"):
        (folder / name).mkdir()
    found = measure_reasons(scale, watch.show, cache)
    write_json(found, folder / "tables" / REASONS)
    centres_page.draw(found.trials, folder / "figures" / centres_page.PICTURE)
    return f"{len(found.trials)} adaptations, each with one thing changed; python -m studies page quotes them"


def page(scale: str, folder: Path, kept: Path, watch: Stopwatch, cache: bool) -> str:
    """Measure and write paper.md, figures/ and tables/; reasons are those in the folder `kept`."""
    write_page(scale, folder, watch.show, cache, kept)
    return verdicts.counted(read_page(folder, kept))


def again(folder: Path, kept: Path) -> str:
    """Write paper.md from what is stored in the folder `kept`."""
    write_again(kept, folder)
    found = read_page(kept)
    if found.reasons is not None:
        (folder / "figures").mkdir()
        centres_page.draw(found.reasons.trials, folder / "figures" / centres_page.PICTURE)
    return verdicts.counted(found)
