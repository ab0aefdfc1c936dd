"""A few sizes of the disk for each format; `tests.fuzz.disk` has them all."""

from collections import Counter
from importlib import import_module
from itertools import chain

import pytest

from tests.fuzz.disk import CASES, DRAWING, SLOW, deflections, limited


@pytest.mark.parametrize("name", [*chain(*SLOW.values()), *DRAWING])
def test_a_function_whose_result_is_kept_is_there(name):
    place, _, function = f"{CASES}.{name}".rpartition(".")
    assert callable(getattr(import_module(place), function))


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_full_disk_keeps_the_old_files_and_is_one_line_that_names_the_target(tmp_path):
    for i, work in enumerate(deflections(tmp_path, cells=2)):
        disk = tmp_path / f"disk {i}"
        disk.mkdir()
        found = list(limited(work, disk, 1 << 16, most=3))
        assert not [(work.name, *one) for one in found if one[1] not in ("kept", "written")]
        assert Counter(text for _, text in found)["kept"] >= 2, (work.name, found)
