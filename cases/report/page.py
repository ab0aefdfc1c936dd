"""The page of a run: one self-contained file."""

from base64 import b64encode
from pathlib import Path
from platform import platform, python_version

from jinja2 import Environment, PackageLoader

from cases.metrics import metrics
from cases.overrides import to_toml
from cases.report.figures import draw_all
from cases.run import Run


def write_report(run: Run, folder: Path) -> None:
    """Write report.html and figures/*.png into `folder`."""
    figures = draw_all(run, folder / "figures")
    environment = Environment(loader=PackageLoader("cases.report", "."), autoescape=True)
    page = environment.get_template("page.html").render(
        run=run,
        metrics=metrics(run),
        parameters=to_toml(run.case),
        figures=[(_inline(folder / "figures" / name), text) for name, text in figures.items()],
        environment=f"Python {python_version()}, {platform()}",
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _inline(path: Path) -> str:
    return "data:image/png;base64," + b64encode(path.read_bytes()).decode("ascii")
