"""Numbers of the interpolation are checked when they are made."""

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from sdm_deflect.base.schema import Range, settings_in
from sdm_deflect.deform.rbf.fitting import Fitting

LEAST = {name: setting.note(Range).low for name, setting in settings_in(Fitting).items() if setting.note(Range)}


@pytest.mark.parametrize("name", LEAST)
def test_a_number_below_its_least_or_not_finite_is_named(name):
    for value in (LEAST[name] - 1, np.nan, np.inf):
        with pytest.raises(InputError, match=f"{name} = {value:g} must be a .*number of at least {LEAST[name]:g}"):
            Fitting(**{name: value})


def test_words_are_those_known():
    with pytest.raises(InputError, match="strategy = 'both' must be squv or mv"):
        Fitting(strategy="both")
    with pytest.raises(InputError, match="rule = 'best' must be separated or worst"):
        Fitting(rule="best")


def test_there_is_room_for_the_initial_centres():
    assert Fitting(max_centers=60).max_centers == 60
    with pytest.raises(InputError, match="max_centers = 59 is fewer than the 60 initial centres"):
        Fitting(max_centers=59)
