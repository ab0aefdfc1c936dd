"""The notebooks of the tutorials: what the guide offers to download opens and runs with the package and its extra."""

import ast
import base64
import re
import sys
import tomllib

import nbformat
import pytest
from nbclient import NotebookClient
from notebooks import is_notebook, notebook_of, picture_of

from tests.docs.commands import ROOT
from tests.pictures import inked, pixels

FOLDER = ROOT / "docs" / "tutorials"
PAGES = sorted(page for page in FOLDER.glob("*.md") if is_notebook(page))
# Modules that bear another name than what installs them.
MODULES = {"mpl_toolkits": "matplotlib"}


def code(page):
    """The cells of code."""
    return [cell for cell in notebook_of(page).cells if cell.cell_type == "code"]


def imported(source):
    """The modules that a cell imports, without their parts; what begins with ! is a command."""
    nodes = list(ast.walk(ast.parse(source.partition("!COLUMNS")[0])))
    names = [one.name for node in nodes if isinstance(node, ast.Import) for one in node.names]
    names += [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    return {name.partition(".")[0] for name in names}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_notebook_is_one_and_needs_no_more_than_the_package(page):
    notebook = notebook_of(page)
    nbformat.validate(notebook)
    assert not [cell for cell in notebook.cells if "```{" in cell.source]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    needs = [*project["dependencies"], *extras["notebook"], *extras["report"]]
    known = {re.split(r"[^\w-]", need)[0] for need in needs}
    known |= {"sdm_deflect", *sys.stdlib_module_names}
    wanted = {name for cell in code(page) for name in imported(cell.source)}
    assert {MODULES.get(name, name) for name in wanted} <= known


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_notebook_beside_a_page_is_the_page(page):
    """`python docs/_ext/notebooks.py` writes them."""
    assert nbformat.read(page.with_suffix(".ipynb"), as_version=4) == notebook_of(page)


def test_links_of_a_notebook_do_not_lead_to_pages_that_are_not_there(tmp_path):
    page = tmp_path / "page.md"
    head = "---\nfile_format: mystnb\nkernelspec:\n  name: python3\n---\n"
    page.write_text(
        head + "# Title\n\nSee [the theory](../theory.md) and [NumPy](https://numpy.org).\n\n```{code-cell}\n1\n```\n"
    )
    text, cell = notebook_of(page).cells
    assert text.source.endswith("See *the theory* and [NumPy](https://numpy.org).")
    assert cell.source == "1"


def test_a_downloaded_notebook_runs_and_draws(tmp_path):
    """As a reader would: the file, a kernel, an empty folder."""
    path = tmp_path / "first-deflection.ipynb"
    nbformat.write(notebook_of(FOLDER / "first-deflection.md"), path)
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    printed = [out.text for cell in notebook.cells for out in cell.get("outputs", ()) if out.output_type == "stream"]
    assert "patches: wing flap far_field" in "".join(printed)
    assert (tmp_path / "airfoil-15.su2").exists()
    (drawn,) = (cell for cell in notebook.cells if "axes.triplot" in cell.source)
    drawn.metadata["tags"] = ["gallery"]
    (tmp_path / "large.png").write_bytes(base64.b64decode(drawn.outputs[0].data["image/png"]))
    (tmp_path / "small.png").write_bytes(picture_of(notebook))
    large, small = (pixels(tmp_path / f"{name}.png") for name in ("large", "small"))
    assert inked(small) > 0.05
    assert small.shape[1] == 560 < large.shape[1]


@pytest.mark.nightly
def test_derivatives_of_the_optimisation_are_those_of_differences_and_lower_the_peak(tmp_path):
    notebook = notebook_of(FOLDER / "optimise-a-flap.md")
    NotebookClient(notebook, timeout=120, resources={"metadata": {"path": tmp_path}}).execute()
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    text = "".join(out.text for out in outputs if out.output_type == "stream")
    assert float(re.search(r"largest relative difference (\S+)", text)[1]) < 1e-6
    before = float(re.search(r"before: peak (\S+) at a lift of 3\.1", text)[1])
    assert float(re.search(r"'peak': ([\d.]+), 'lift': 3\.2", text)[1]) < before - 0.2
    assert "failed" not in text
