"""The report of the fighter with all its surfaces turned, as `fighter.html` of the guide: it is turned in place.

It is made where the notebooks are run, so that a quick build stays quick.
"""

import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from sphinx.application import Sphinx

COMMANDS = (["example", "--fighter"], ["deflect", "fighter.su2", "--config", "fighter.toml", "--quiet"])
REPORT = Path("fighter-deflected-report", "report.html")


def write(app: Sphinx, error: Exception | None) -> None:
    """Write the report beside the pages."""
    if error is not None or app.builder.format != "html" or app.config.nb_execution_mode == "off":
        return
    with TemporaryDirectory() as folder:
        for words in COMMANDS:
            subprocess.run([sys.executable, "-m", "sdm_deflect", *words], cwd=folder, check=True, capture_output=True)
        shutil.copyfile(Path(folder, REPORT), Path(app.outdir, "fighter.html"))


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("build-finished", write)
    return {"parallel_read_safe": True}
