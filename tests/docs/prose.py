"""Sentences of pages, helps and docstrings, measured by textstat: without code, formulas and pictures."""

import re
from collections.abc import Iterator

import textstat
from markdown_it import MarkdownIt
from markdown_it.token import Token

ASIDE = re.compile(
    r"\A---\n(?s:.)*?\n---\n|\$\$(?s:.)*?\$\$.*|\$[^$\n]*\$|^(:::|\[\^).*|^.*\n-+$|^[\w*, ]+ : |^: ", re.MULTILINE
)
"""Front matter, formulas, directives, footnotes, headings of docstrings, and names that a list describes."""
END = re.compile(r"(?<=[.!?])\s+(?=\S)")
WORDS = ("made anew", "anew", "whereto", "told", "dear", "dearer", "is none", "read are", "of which", "that of")
"""Words that one must read twice, or that have a plainer one."""
LONGEST, MEAN = 35, 18
"""Words of a sentence, and of an average one, at most."""


def sentences(text: str) -> Iterator[str]:
    """Yield what ends like a sentence, a word for each piece of code."""
    plain = ASIDE.sub("\n\n", re.sub(r"\n {4,}", "\n", text))
    for token in MarkdownIt().enable("table").parse(plain):
        if token.type == "inline":
            words = " ".join("".join(map(_text, token.children or ())).split())
            yield from (one for one in END.split(words) if one.endswith((".", "!", "?", ":")))


def _text(token: Token) -> str:
    if token.type in ("softbreak", "hardbreak"):
        return " "
    return {"text": token.content, "code_inline": "code"}.get(token.type, "")


def faults(text: str) -> list[str]:
    """Return the sentences that are too long or have a word of the list, and the mean length if that is too large."""
    found = list(sentences(text))
    wrong = [one for one in found if textstat.lexicon_count(one) > LONGEST]
    wrong += [f"{word!r}: {one}" for one in found for word in WORDS if re.search(rf"\b{word}\b", one, re.IGNORECASE)]
    mean = sum(map(textstat.lexicon_count, found)) / max(1, len(found))
    return [*wrong, *([f"{mean:.1f} words on average"] if mean > MEAN and len(found) > 5 else [])]
