"""Every command of README.md, CONTRIBUTING.md and docs is run here, or in a place that is named here."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.cli.examination import PACKAGES
from tests.calls import sdm
from tests.docs.commands import ROOT, lines_of, mentioned, pages, shown

CI = ".ci/run"
# A cell of a tutorial.
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
# Commands that take long, need a network or wait for a user: a pattern, where they are run, and a text found there.
ELSEWHERE = (
    (r"apt-get (update|install)", CI, "apt-get install"),
    (r"python3 -m venv \.venv", CI, "python3 -m venv"),
    (r"\.venv/bin/pip install -c constraints.txt -e '\.\[dev\]'( pre-commit)?", CI, 'bash -euc "$install -q"'),
    (r"(\.venv/bin/)?pip install (-c \S+ )?('\.\[(all|report)\]'|\.)$", CI, "pip install -q --no-deps --target"),
    (r"pip install -e '\.\[test\]'", ".ci/versions", "-e '.[test]'"),
    (r"pytest tests/deform tests/meshing", ".ci/versions", "tests/deform tests/meshing"),
    (r"\. \.venv/bin/activate", CI, "python3 -m venv"),
    (r"\.venv/bin/pre-commit install", ".pre-commit-config.yaml", "repos:"),
    (r"\.venv/bin/python -m pytest -n 3 --dist loadfile", CI, ".venv/bin/python -m pytest"),
    (r"\.venv/bin/(ruff (check|format --check)|mypy|lint-imports)", CI, ".venv/bin/lint-imports"),
    (r"(\.venv/bin/)?sphinx-build", CI, "sphinx-build"),
    (r"sdm run aileron-chimera", "tests/cases/conftest.py", 'case_named("aileron-chimera"), angle=-30.0'),
    (r"sdm run tail$", "tests/cases/conftest.py", 'case_named("tail")'),
    (r"sdm run rudder$", "tests/cases/sdm/test_plans.py", 'case_named("rudder")'),
    (r"sdm run all$", "tests/cases/sdm/test_plans.py", 'case_named("all")'),
    (r"(blockMesh|surfaceFeatureExtract|snappyHexMesh) -case sdm-case", "docs/tests/test_meshers.py", "snappyHexMesh"),
    (r"sdm validate X-report", "tests/cases/test_validated_mesh.py", 'code_of("validate", report'),
    (r"sdm validate", "tests/cases/test_cli.py", 'sdm("validate", '),
    (r"sdm limit aileron", "tests/cases/sdm/test_limit.py", "limit"),
    (r"python -m studies case", "studies/tests/flow/test_case.py", 'run_study("case"'),
    (r"python -m studies flow", "studies/tests/flow/test_study.py", '"flow"'),
    (r"python -m studies", "studies/tests/test_studies.py", "study"),
    (r"sdm report wing-deflected-report", "tests/cases/test_mesh_report.py", "again = FinishedRun.of(folder).report()"),
    (r"sdm deflect wing\.cas\.h5", "tests/cases/test_deflect_command.py", 'folder / "wing.cas.h5"'),
    (r"sdm deflect wing\.p3d", "tests/meshing/formats/test_plot3d_map.py", "sdm.deflect(source, "),
    (r"sdm view", "tests/cases/test_view.py", '"view"'),
    (r"rhoCentralFoam -case naca-flow", "studies/tests/flow/test_case.py", 'lines("rhoCentralFoam", case)'),
    (
        r"(reconstructParMesh|sdm (deflect|apply|quality)) .*case",
        "tests/cases/test_apply.py",
        'sdm("apply", field, *AT_8, *parts',
    ),
    (r"sdm deflect fighter\.su2 .* --margin 0\.005", "docs/tests/test_teaching.py", "lesson([*words[:-1], margin])"),
    (r"sdm deflect full\.su2", "tests/deform/volume/test_mirror.py", '"--mirror", other'),
    (r"sdm deflect .* --to surface_positions\.dat", "tests/cases/test_to.py", '"--to"'),
    (r"sdm (quality|deflect) 30p30n\.su2", "tests/cases/test_tracks.py", '"--slot", "rest", "--gap"'),
    (r"pip install '\.\[gpu\]'", "pyproject.toml", "gpu = ["),
    (r"python -m benchmarks(?!\.large_block)", "benchmarks/README.md", "python -m benchmarks"),
    (r"pip install '\.\[cluster\]'", "pyproject.toml", "cluster = ["),
    (r"pip install '\.\[notebook\]'", "pyproject.toml", "notebook = ["),
    (r"jupyter lab", "docs/tests/test_tutorials.py", "NotebookClient"),
    (r"dask (scheduler|worker)", "tests/cases/test_cluster.py", "distributed.cli.dask_scheduler"),
    (r"sdm deflect .* --scheduler", "tests/cases/test_cluster.py", '"--scheduler", file'),
    (r"mpirun -np 4 checkMesh", "tests/cases/test_apply.py", 'foam.run("checkMesh", one, ranks=count)'),
)


def elsewhere(command: str) -> tuple[str, str] | None:
    """Return where a command is run if not here."""
    return next(((path, text) for pattern, path, text in ELSEWHERE if re.match(pattern, command)), None)


def here() -> dict[str, list[str]]:
    """Return the commands to run by page, each once."""
    seen: set[str] = set()
    found: dict[str, list[str]] = {}
    for page in pages():
        commands = [plain(command) for command in shown(page) if elsewhere(command) is None]
        found[str(page.relative_to(ROOT))] = [command for command in dict.fromkeys(commands) if command not in seen]
        seen.update(commands)
    return found


def plain(command: str) -> str:
    """Return a command as typed with the environment active, without what is its default."""
    return command.removeprefix(".venv/bin/").replace("sdm run aileron --scale small", "sdm run aileron")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, aileron_mesh):
    """A folder in which the commands of all pages run, with the guide at its place; those of the README have run."""
    path = tmp_path_factory.mktemp("reader")
    for name in ("docs", "benchmarks"):
        (path / name).symlink_to(ROOT / name)
    with pytest.MonkeyPatch.context() as patch:
        for command in here()["README.md"]:
            assert run(command, path, patch) == 0, command
    return path


def make_tail(folder: Path) -> None:
    """Write the mesh of a tail on a fuselage as the tutorial does; several pages deflect it."""
    text = (ROOT / "docs" / "tutorials" / "tail-on-fuselage.md").read_text(encoding="utf-8")
    cell = next(code for code in CELL.findall(text) if "def tail_on_fuselage" in code)
    code = cell.partition('tail_on_fuselage("tail.su2")')
    subprocess.run([sys.executable, "-c", "".join(code[:2])], cwd=folder, stdout=subprocess.DEVNULL, check=True)


def run(command: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> int:
    """Run `sdm` in this process, and anything else in a shell."""
    if not command.startswith("sdm "):
        python = f'python() {{ {shlex.quote(sys.executable)} "$@"; }}; '
        return subprocess.run(["bash", "-c", python + command], cwd=folder, stdout=subprocess.DEVNULL).returncode
    monkeypatch.chdir(folder)
    return int(sdm(*shlex.split(command)[1:]) or 0)


@pytest.mark.parametrize("path", [path for _, path, _ in ELSEWHERE])
def test_the_places_that_run_costly_commands_exist(path):
    assert (ROOT / path).exists()


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_costly_commands_are_found_where_the_table_says(page):
    for command in shown(page):
        path, text = elsewhere(command) or (str(page), "")
        assert not text or text in (ROOT / path).read_text(encoding="utf-8"), command


def test_the_pipeline_reads_packages_and_set_up_from_the_readme():
    """Its own lines, carried out: what they find, put together again, is the command of the README."""
    text = (ROOT / CI).read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if re.match(r"(command|packages|install)=", line)]
    show = 'printf "%s\\n" "$packages" "$install" "${command##*-m pytest}"'
    words = ["bash", "-euc", "\n".join([*lines, show])]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True)
    packages, install, options = done.stdout.splitlines()
    assert {"python3-venv", "openfoam", "chromium"} <= set(packages.split())
    assert install == "/usr/bin/python3 -m venv .venv && .venv/bin/pip install -c constraints.txt -e '.[dev]'"
    install = install.removeprefix("/usr/bin/")
    whole = f"apt-get update && apt-get install -y --no-install-recommends {packages} && {install} && "
    assert f"{whole}.venv/bin/python -m pytest{options}" in lines_of(ROOT / "README.md")


def test_every_set_up_of_the_readme_asks_for_the_same_packages():
    asked = [line for line in lines_of(ROOT / "README.md") if "apt-get install" in line]
    assert len(asked) == 2
    assert all(f"python3-venv {PACKAGES}" in line for line in asked)


def test_the_readme_shows_and_links_what_is_there():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    places = re.findall(r"\]\(([^)#]+)\)", text)
    assert len(places) > 10
    assert [place for place in places if not (ROOT / place).exists()] == []


@pytest.mark.mesher
def test_commands_of_the_readme_succeed(folder):
    assert (folder / "runs" / "aileron" / "report.html").exists()


@pytest.mark.nightly
@pytest.mark.parametrize("page", [name for name, commands in here().items() if commands and name != "README.md"])
def test_commands_of_a_page_succeed(page, folder, monkeypatch):
    for command in here()[page]:
        if " tail.su2 " in command and not (folder / "tail.su2").exists():
            make_tail(folder)
        assert run(command, folder, monkeypatch) == 0, command


@pytest.mark.parametrize("page", pages(), ids=lambda page: page.name)
def test_commands_in_sentences_exist_with_their_options(page):
    for words in mentioned(page):
        named = [word for word in words[1:2] if word.isalpha()]
        for name in named:
            assert name in cli.commands, " ".join(words)
            known = {"--help", *(option for one in cli.commands[name].params for option in one.opts)}
            known.update(option for one in cli.commands[name].params for option in one.secondary_opts)
            assert {word for word in words if word.startswith("--")} <= known, " ".join(words)


def test_every_command_that_a_reader_may_type_is_in_the_guide():
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages())
    assert [name for name in cli.commands if f"sdm {name}" not in text] == []
