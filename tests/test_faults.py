"""The faults that `python -m tests.faults` plants: each line is still there, in one file, once."""

from tests.faults import FAULTS, ROOT


def test_every_fault_can_be_planted():
    for fault in FAULTS:
        assert fault.file(ROOT).is_file()
        assert fault.old != fault.new
