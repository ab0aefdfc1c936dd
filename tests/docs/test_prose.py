"""What people read is in short sentences and plain words: pages, helps, public docstrings, the newest changes."""

import ast
import inspect
import re

import pytest

import sdm_deflect
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.settings.job_settings import BY_NAME
from tests.docs.commands import ROOT, pages
from tests.docs.prose import faults, sentences

PRODUCT = ("geometry", "meshing", "deform", "cases")
ERRORS = re.compile("[A-Za-z]+Error|KeyboardInterrupt")
"""Errors, which a docstring may name without backticks: they are what it raises."""
TYPES = ("CadFace", "CadEdge")
"""Types of attributes in docstrings."""
FOREIGN = ("owner", "centers_x", "beta_x", "alpha_x")
"""Names in files: of OpenFOAM, and of arrays whose names are put together."""


def test_a_long_sentence_a_word_of_the_list_and_a_long_mean_are_found():
    assert faults("A flap turns. It is `held` and [told](there), of which\n\n```\nanew.\n```\n") == []
    assert faults("Read are SU2 files, and meshes are made anew.") != []
    assert faults(f"{'word ' * 36}end.") != []
    assert faults(f"{'word ' * 20}end.\n\n" * 6) == ["21.0 words on average"]
    assert list(sentences("| a |\n| --- |\n| a cell. |\n\n- An item\n  goes on.\n- Another.")) == [
        "a cell.",
        "An item goes on.",
        "Another.",
    ]


@pytest.mark.parametrize("page", [*pages(), ROOT / "SECURITY.md"], ids=lambda page: page.name)
def test_pages_are_in_short_sentences_and_plain_words(page):
    assert faults(page.read_text(encoding="utf-8")) == []


def test_the_newest_changes_are_in_short_sentences_and_plain_words():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert faults(text.split("\n## ")[1]) == []


@pytest.mark.parametrize("name", [name for name in cli.commands if name != "study"])
def test_helps_are_in_short_sentences_and_plain_words(name):
    command = cli.commands[name]
    texts = [inspect.cleandoc(command.help or ""), *(getattr(one, "help", None) or "" for one in command.params)]
    assert faults("\n\n".join(texts)) == []


def test_settings_are_in_short_sentences_and_plain_words():
    assert faults("\n\n".join(f"{one.doc.text} {one.doc.more}" for one in BY_NAME.values())) == []


@pytest.mark.parametrize("name", [name for name in sdm_deflect.__all__ if name != "__version__"])
def test_public_docstrings_are_in_short_sentences_and_plain_words(name):
    thing = getattr(sdm_deflect, name)
    members = vars(thing).items() if inspect.isclass(thing) else ()
    public = [member for key, member in members if not key.startswith("_")]
    for one in (thing, *public):
        assert faults(inspect.getdoc(one) or "") == [], one


def docstrings(*folders):
    """Yield the name, docstring and syntax tree of each module, class and function in some folders."""
    for path in sorted(path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and (text := ast.get_docstring(node)):
                yield f"{path.relative_to(ROOT)}: {getattr(node, 'name', '')}", text, node


def test_the_docstrings_of_the_engine_are_in_short_sentences_and_plain_words():
    read = list(docstrings("deform"))
    assert {"deform/confined.py: ", "deform/held.py: HeldPlan"} < {name for name, _, _ in read}
    assert {name: found for name, text, _ in read if (found := faults(text))} == {}


def test_docstrings_name_no_class_by_accident():
    """A script that renames a class may also rename words of sentences."""
    texts = list(docstrings(*PRODUCT))
    classes = {node.name for _, _, node in texts if isinstance(node, ast.ClassDef)} - {*TYPES}
    double = {name for name in classes if re.search("[a-z][A-Z]", name) and not ERRORS.fullmatch(name)}
    found = []
    for name, text, _ in texts:
        plain = re.sub(r"`[^`]*`|^\S.*\n-+$", "", text, flags=re.MULTILINE)
        found += [f"{name}: {word}" for word in re.findall(r"\b[A-Z]\w+\b", plain) if word in double]
    assert found == []


def test_names_in_backticks_exist():
    code = "\n".join(path.read_text(encoding="utf-8") for folder in PRODUCT for path in (ROOT / folder).rglob("*.py"))
    known = {*re.findall(r"\w+", re.sub(r"`[^`\n]*`", "", code)), *FOREIGN}
    named = ((name, word) for name, text, _ in docstrings(*PRODUCT) for word in re.findall(r"(?<!`)`(\w+)`(?!`)", text))
    assert [f"{name}: {word}" for name, word in named if word not in known] == []
