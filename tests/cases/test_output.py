"""Folders of results: replaced as one, with what users keep in them."""

import csv
from fnmatch import fnmatchcase

import pytest

from sdm_deflect.cases.run.output import PAGE, OutputError, output_folder, text_of, write_table

FIRST = ("case.toml", "deflected.vtu", "report.html", "figures/slices_tail.png", "figures/mine.png", "notes.txt")


def put(folder, names, text):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def texts(folder):
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_a_run_without_report_leaves_none_of_an_earlier_run_and_all_of_the_users(tmp_path, monkeypatch):
    folder = tmp_path / "run"
    put(folder, FIRST, "old")
    with output_folder(folder) as scratch:
        put(scratch, ("case.toml", "deflected.vtu"), "new")
        assert set(texts(folder).values()) == {"old"}
    users = {"figures/mine.png": "old", "notes.txt": "old"}
    assert texts(folder) == {"case.toml": "new", "deflected.vtu": "new"} | users
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    monkeypatch.chdir(folder / "figures")
    with pytest.raises(OutputError, match="this command works in the folder"), output_folder(folder):
        pass


def test_a_new_report_leaves_all_but_the_old_one(tmp_path):
    put(tmp_path / "run", FIRST, "old")
    with output_folder(tmp_path / "run", PAGE) as scratch:
        put(scratch, ("report.html", "figures/quality.png"), "new")
    kept = {name: "old" for name in FIRST if not any(fnmatchcase(name, pattern) for pattern in PAGE)}
    assert texts(tmp_path / "run") == kept | {"report.html": "new", "figures/quality.png": "new"}


def test_a_file_in_the_place_of_the_folder_is_named(tmp_path):
    place = tmp_path / "run"
    place.write_text("mine")
    with pytest.raises(OutputError, match=rf"--out {place}: .*; choose a folder"), output_folder(place):
        pass
    assert texts(tmp_path) == {"run": "mine"}


def test_no_cell_of_a_table_is_a_formula_and_every_text_comes_back(tmp_path):
    names = [
        '=HYPERLINK("http://a")',
        "+1+cmd|' /C calc'!A0",
        "-2+3",
        "@SUM(1)",
        "\tx",
        "\rx",
        "'=x",
        "''",
        "wing",
        "a=b",
    ]
    write_table(tmp_path / "table.csv", [names, ["-12.5", "+1e-3", -3, 2.0]])
    with (tmp_path / "table.csv").open(newline="", encoding="utf-8") as file:
        texts, numbers = csv.reader(file)
    assert not [one for one in texts if one.startswith(("=", "+", "-", "@", "\t", "\r"))]
    assert list(map(text_of, texts)) == names
    assert numbers == ["-12.5", "+1e-3", "-3", "2.0"]
