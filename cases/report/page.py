"""The page of a run: one self-contained file that asks no network for anything."""

from base64 import b64encode
from collections.abc import Iterable
from dataclasses import replace
from gzip import compress
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from PIL import Image

from sdm_deflect.cases.overrides import to_toml
from sdm_deflect.cases.report.gallery import Exhibit, Gallery, compared
from sdm_deflect.cases.report.interactive import MOST_CELLS, turnable
from sdm_deflect.cases.report.story import Story
from sdm_deflect.cases.report.words import STATES, meaning, parameter_tables
from sdm_deflect.cases.surroundings import surroundings, versions


def write_report(story: Story, gallery: Gallery, folder: Path) -> None:
    """Write report.html and the figures that show the validation into `folder`; the gallery is the other figures."""
    exhibits = (*gallery.exhibits, *compared(story, folder / "figures"))
    (folder / "report.html").write_text(page(story, replace(gallery, exhibits=exhibits)), encoding="utf-8")


def page(story: Story, gallery: Gallery) -> str:
    """Return the page; every text in it is escaped, and no script but its own two can run."""
    library, viewer = plotly(), own("viewer.js")
    environment = Environment(
        loader=PackageLoader("sdm_deflect.cases.report", "."), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters |= {"inline": inline, "pixels": pixels, "meaning": meaning}
    return environment.get_template("page.html").render(
        story=story,
        figures=story.figures,
        gallery=gallery,
        states=STATES,
        scene=turnable(story),
        most_cells=MOST_CELLS,
        parameters=parameter_tables(story.case),
        toml=to_toml(story.case),
        toml_file=b64encode(to_toml(story.case).encode()).decode("ascii"),
        surroundings=surroundings(),
        versions=versions(),
        style=own("style.css"),
        library=b64encode(compress(library.encode(), mtime=0)).decode("ascii"),
        viewer=viewer,
        policy=policy([library, viewer]),
    )


def policy(scripts: Iterable[str]) -> str:
    """Return the content security policy: nothing from any network, no script but these."""
    hashes = " ".join(
        f"'sha256-{b64encode(sha256(one.encode()).digest()).decode('ascii')}'"
        for one in scripts
    )
    return f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'"


def own(name: str) -> Markup:
    """Return a file beside this one as it is, for a place where nothing is escaped."""
    return Markup(files("sdm_deflect.cases.report").joinpath(name).read_text(encoding="utf-8"))


def plotly() -> str:
    """Return the plotting library; it goes into the page compressed, as a third of its size."""
    return files("plotly").joinpath("package_data", "plotly.min.js").read_text(encoding="utf-8").replace("\r\n", "\n")


def inline(exhibit: Exhibit) -> str:
    """Return a picture as the address of itself."""
    return "data:image/png;base64," + b64encode(exhibit.path.read_bytes()).decode("ascii")


def pixels(exhibit: Exhibit) -> tuple[int, int]:
    """Return width and height of a picture, so that the page does not jump while it loads."""
    with Image.open(exhibit.path) as image:
        return image.size
