"""A finished folder is validated from its files alone."""

import pytest

from sdm_deflect.cases.aircraft.run_folder import read_run, validate_folder
from sdm_deflect.cases.errors import InputError


@pytest.mark.mesher
def test_the_same_checks_pass_again(aileron_run):
    run, folder = aileron_run
    checks = validate_folder(folder)
    own = {"same_deflection", "undeflected_mesh", "stored_arrays", "stored_figures"}
    assert {c.name: c.passed for c in checks} == dict.fromkeys({c.name for c in run.checks} | own, True)


def test_a_folder_without_a_run_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"it has no case\.toml"):
        read_run(tmp_path)
