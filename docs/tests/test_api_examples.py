"""The examples in the reference of the public names run, and there is one for each name."""

import doctest
import re

import pytest

import sdm_deflect
from tests import calls
from tests.docs.commands import ROOT

PAGE = ROOT / "docs" / "api" / "public.md"
BLOCKS = re.findall(r"^```pycon\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def test_each_public_name_has_an_example():
    used = set(re.findall(r"sdm\.(\w+)", "".join(BLOCKS)))
    assert set(sdm_deflect.__all__) - used == {"__version__"}


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_the_examples_run_as_they_stand(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert calls.sdm("example") == 0
    examples = doctest.DocTestParser().get_doctest("\n".join(BLOCKS), {}, PAGE.name, str(PAGE), 0)
    told = []
    result = doctest.DocTestRunner(verbose=False).run(examples, out=told.append)
    assert result.failed == 0, "".join(told)
    assert result.attempted > 30
