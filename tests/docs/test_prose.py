"""What people read is in short sentences and plain words: pages, helps, public docstrings, the newest changes."""

import inspect

import pytest

import sdm_deflect
from sdm_deflect.cases.cli.commands import cli
from sdm_deflect.cases.settings.job_settings import BY_NAME
from tests.docs.commands import ROOT, pages
from tests.docs.prose import faults, sentences


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
