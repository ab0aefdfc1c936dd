"""The tables of docs/flow.md follow from the results that are kept."""

import re

import pytest

from studies.flow import kept


@pytest.mark.parametrize("name", ["aileron", "aileron-angles", "tail", "aileron-free"])
def test_differences_are_those_of_the_columns(name):
    """Rows of a repaired mesh are of that one; five decimals of a small increment leave a tenth of a per cent open."""
    for row in kept.tables(name)[0]:
        said = float(row["difference"].split()[0])
        assert float(kept.share(row, "repaired" if "repaired" in row else "deflected").split()[0]) == pytest.approx(
            said, abs=0.15
        )


def test_agreement_is_within_the_scatter_or_two_per_cent():
    for name in ("aileron", "aileron-angles", "tail"):
        for row in kept.tables(name)[0]:
            own, new = (float(row[key]) for key in ("repaired" if "repaired" in row else "deflected", "new meshes"))
            scatter = float(row["scatter"].strip("()")) if row["scatter"] else 0.0
            allowed = max(scatter, 0.02 * abs(new))
            if abs(abs(own - new) - allowed) > 2e-5:  # rounded numbers cannot tell
                assert (row["agrees"] == "yes") == (abs(own - new) < allowed), row


def test_slopes_are_those_of_the_study():
    text = (kept.RESULTS / f"flow-{kept.OVER_ANGLE}.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^(C\w): (-?[\d.]+) per degree", text, re.MULTILINE))
    row = next(line for line in kept.slopes().splitlines() if line.startswith("| deflected mesh, -6"))
    for name, own in zip(kept.NAMES, row.split("|")[2:6], strict=True):
        assert float(own) == pytest.approx(float(said[name]), rel=2e-3)


def test_the_number_of_meshes_is_that_of_the_normal_test():
    """Twice the variance over n, against the square of 2 per cent over 1.96."""
    spread, count = map(float, re.search(r"deviation of ([\d.]+) %.* some (\d+) meshes", kept.needed()).groups())
    assert 1.96 * spread * (2.0 / count) ** 0.5 == pytest.approx(2.0, rel=0.02)
