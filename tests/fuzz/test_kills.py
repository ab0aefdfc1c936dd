"""Some of the moments at which `tests.fuzz.kills` ends a command."""

from random import Random

import pytest

from tests.fuzz import kills
from tests.fuzz.kills import SIGNALS, Scenario, kill

pytestmark = pytest.mark.nightly


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    return Scenario("deflect, sensitivity", tmp_path_factory.mktemp("kills") / "place")


@pytest.fixture(autouse=True)
def patient(monkeypatch):
    """A loaded machine may take longer than two seconds for what takes one."""
    monkeypatch.setattr(kills, "SECONDS", 10.0)


def test_a_command_ended_at_a_rename_leaves_each_file_old_or_new(scenario):
    assert scenario.renames == len(scenario.old) - 1
    for at in range(1, scenario.renames + 1):
        assert not kill(scenario, SIGNALS[-at % len(SIGNALS)], at).wrong


def test_a_command_ended_at_any_moment_leaves_each_file_old_or_new(scenario):
    random = Random(7)
    for number in SIGNALS:
        assert not kill(scenario, number, random.uniform(0.1, 1.0) * scenario.seconds).wrong
