"""Commands carried out in this process, and a limit of the size of files in the place of a full disk."""

import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from sdm_deflect.cases.cli import commands
from studies.__main__ import study


def sdm(*words: object) -> int:
    """Carry out `sdm` with these words; return its exit code."""
    return _code(("sdm", *words), commands.carry_out)


def run_study(*words: object) -> int:
    """Carry out `python -m studies` with these words; return its exit code."""
    return _code(("studies", *words), lambda: commands.carry_out(study, "python -m studies"))


def _code(words, main) -> int:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", list(map(str, words)))
        with pytest.raises(SystemExit) as end:
            main()
    return end.value.code


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """Let no file grow beyond so many bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
