"""What is shown while a case runs and when it has ended."""

import re
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.threads import unseen
from sdm_deflect.cases.cli.console import WIDTH, check_table, console
from sdm_deflect.cases.cli.options import print_tables
from sdm_deflect.cases.cli.run import case_table
from sdm_deflect.cases.finished import read_run
from sdm_deflect.cases.run.progress import Stopwatch, lines, show_stages
from sdm_deflect.deform.checks import Check

ESCAPE = "\x1b"
CHECKS = (
    Check("[bold]planarity", 2.0, 1.0, "m", "[red]12 nodes"),
    Check("quality_min", 0.4, 0.25, "-", "", "at least"),
)


def printed(what, width=WIDTH, **settings):
    out = StringIO()
    Console(file=out, width=width, **settings).print(what)
    return out.getvalue()


def test_table_is_plain_where_there_is_no_terminal():
    text = printed(check_table(CHECKS, "[link]case"))
    assert ESCAPE not in text
    assert all(word in text for word in ("[bold]planarity", "[red]12 nodes", "[link]case", "FAILED", ">= 0.25 "))


def test_names_do_not_command_the_terminal(capsys):
    checks = check_table((Check("planarity\x1b[31m", 2.0, 1.0, "m", "\x07nodes"),), "wing\x1b[2J")
    print_tables(checks, "wrote a\x1b]0;b.su2")
    out = capsys.readouterr().out
    assert all(character.isprintable() or character == "\n" for character in out)
    assert all(text in out for text in (r"planarity\x1b[31m", r"wing\x1b[2J", r"wrote a\x1b]0;b.su2"))
    assert str(InputError("the patch fl\x1b[31m is none")) == r"the patch fl\x1b[31m is none"
    told = StringIO()
    with Stopwatch(lines(Console(file=told, width=WIDTH))).stage("read") as tell:
        tell("reading wing\x1b[2J.su2", 0.5)
    assert r"reading wing\x1b[2J.su2" in told.getvalue()


def test_no_color_is_honoured(monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    text = printed(check_table(CHECKS, "case"), force_terminal=True)
    assert f"{ESCAPE}[3" not in text


def test_table_is_wide_in_a_pipe_unless_told(monkeypatch):
    monkeypatch.setattr("sys.stdout", StringIO())
    monkeypatch.delenv("COLUMNS", raising=False)
    assert console().width == WIDTH
    monkeypatch.setenv("COLUMNS", "70")
    assert console().width == 70
    monkeypatch.setenv("COLUMNS", "wide")
    assert console().width == WIDTH


@pytest.mark.parametrize(
    ("switches", "terminal", "expected"),
    [
        ({"verbose": True}, True, ["begins", "x: 54 centres", "263 centres", "ends"]),
        ({}, True, ["263 centres"]),
        ({}, False, ["263 centres"]),
        ({"quiet": True}, True, []),
        ({"quiet": True, "verbose": True}, False, []),
    ],
)
def test_switches_choose_what_is_shown(switches, terminal, expected):
    out = StringIO()
    console = Console(file=out, width=WIDTH, force_terminal=terminal)
    with show_stages(**{"quiet": False, "verbose": False} | switches, console=console) as show:
        watch = Stopwatch(show)
        with watch.stage("deformation") as tell:
            tell("x: 54 centres, error 7e-05 m", 0.5)
            tell("263 centres", float("nan"))
    assert all(words in out.getvalue() for words in expected)
    assert bool(out.getvalue()) == bool(expected)
    assert (show is unseen) == ("quiet" in switches)
    assert set(watch.seconds) == {"deformation"}


def test_a_pipe_gets_one_line_for_each_stage_and_no_spinner():
    out = StringIO()
    with show_stages(console=Console(file=out, width=20), quiet=False, verbose=False) as display:
        watch = Stopwatch(display)
        for stage in ("geometry", "mesh"):
            with watch.stage(stage) as progress:
                progress("first", 0.5)
                progress(f"[red]last of {stage}", 1.0)
    assert [line.split(" s  ")[1] for line in out.getvalue().splitlines()] == [
        "[red]last of geometry",
        "[red]last of mesh",
    ]


def test_report_of_no_run_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match="is not the output folder of a run"):
        read_run(tmp_path)


def test_a_check_over_nothing_is_not_applicable():
    text = printed(check_table([Check("on_symmetry", 0.0, 0.0, "", "0 sliding nodes", over=0)], "case"))
    assert "not applicable" in text
    assert "passed" not in text


def test_texts_are_printed_as_they_are_one_below_the_other(capsys):
    print_tables(check_table(CHECKS, "case"), "results in runs/[bold]mine", "all validations passed")
    assert capsys.readouterr().out.splitlines()[-2:] == ["results in runs/[bold]mine", "all validations passed"]


@pytest.mark.mesher
def test_a_case_is_printed_as_any_deflection(aileron_run):
    text = printed(case_table(aileron_run[0], Path("runs/mine"), whole=True))
    lines = text.splitlines()
    for begin in (
        "aileron_left +",
        "box ",
        "data sites: ",
        "kernel: thin plate",
        "fit +interpolation: ",
        "wrote +runs/mine",
    ):
        assert any(re.match(begin, line) for line in lines), begin
    assert "surface_to_cad" in text
    assert lines[-1].startswith("all validations passed")


@pytest.mark.mesher
def test_a_case_fits_a_terminal_and_names_only_failed_checks(aileron_run):
    text = printed(case_table(aileron_run[0], Path("runs/mine"), whole=False), width=80)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 20
    assert "surface_to_cad" not in text
    assert re.search(r"(\d+) of \1 checks passed \(--verbose: each\)", text)
