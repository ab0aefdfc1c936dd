"""SU2's configurations: names and values that SU2 has, markers, and origins that make moments hinge moments."""

import tomllib
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from sdm_deflect.base.errors import InputError
from studies.flow.setup import FreeStream, Hinge, Setup
from studies.flow.su2 import check_name, configuration

OPTIONS = tomllib.loads(Path(__file__).with_name("su2_options.toml").read_text(encoding="utf-8"))
KINDS = {"wing": "wall", "far": "far", "flap": "wall", "symmetry": "symmetry"}
FLAP = Hinge.through("flap", ["flap"], np.array([[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]))
SETUP = Setup(FreeStream(0.7, 2.0, 3.0, 5e4, 250.0), (FLAP,), (0.1, 0.2, 0.3), area=2.0, length=0.5, iterations=7)


def options(text):
    """The options of a configuration, without comments."""
    lines = [line for line in text.splitlines() if line and not line.startswith("%")]
    pairs = [line.partition("= ")[::2] for line in lines]
    assert len(dict(pairs)) == len(lines)
    return dict(pairs)


def words(value):
    """The words of a value: one, or those in brackets."""
    return value[1:-1].replace(",", " ").split() if value.startswith("(") and value.endswith(")") else [value]


def is_number(word):
    try:
        return isfinite(float(word))
    except ValueError:
        return False


def faults(text, markers):
    """Lines of a configuration that SU2 has not, by its own list of options."""
    found = []
    for name, value in options(text).items():
        allowed, given = OPTIONS.get(name), words(value)
        right = {
            "number": len(given) == 1 and is_number(value),
            "numbers": all(map(is_number, given)),
            "markers": value.startswith("( ") and (given == ["NONE"] or set(given) <= set(markers)),
            "text": len(value.split()) == 1,
        }
        if not (right[allowed] if isinstance(allowed, str) else allowed and set(given) <= set(allowed)):
            found.append(f"{name}= {value}")
    return found


def written(setup=SETUP, kinds=KINDS):
    return configuration(kinds, Path("a/naca_-10.su2"), setup)


@pytest.mark.parametrize("setup", [SETUP, Setup()])
def test_names_and_values_are_those_of_su2(setup):
    assert faults(written(setup), KINDS) == []


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("MACH_NUMBER=", "MACH="),
        ("SOLVER= EULER", "SOLVER= Euler"),
        ("MARKER_EULER=", "MARKER_WALL="),
        ("TD_CONDITIONS", "THERMODYNAMIC"),
        ("JST\n", "JTS\n"),
        ("( wing, flap )", "( wing, flip )"),
        ("RMS_RES", "RMS_RESIDUAL"),
        ("CFL_NUMBER= 10", "CFL_NUMBER= ten"),
        ("AOA= 2.0", "AOA= nan"),
        ("naca_-10.su2", "naca -10.su2"),
    ],
)
def test_a_misspelt_option_or_value_is_seen(right, wrong):
    text = written()
    assert right in text
    assert faults(text.replace(right, wrong), KINDS)


def test_the_free_stream_and_each_marker_are_there():
    found = options(written())
    assert [float(found[name]) for name in ("MACH_NUMBER", "AOA", "FREESTREAM_PRESSURE", "ITER")] == [0.7, 2, 5e4, 7]
    assert float(found["SIDESLIP_ANGLE"]) == -3.0  # SU2's turns the wind towards +y, ours comes from there
    assert [float(found[name]) for name in ("REF_AREA", "REF_LENGTH")] == [2.0, 0.5]
    assert (found["MARKER_FAR"], found["MARKER_SYM"]) == ("( far )", "( symmetry )")
    assert found["MARKER_EULER"] == found["MARKER_MONITORING"] == found["MARKER_PLOTTING"] == "( wing, flap )"
    assert found["MESH_FILENAME"] == "naca_-10.su2"
    assert len({found[f"{name}_FILENAME"] for name in ("CONV", "RESTART", "VOLUME", "SURFACE")}) == 4
    assert all(found[f"{name}_FILENAME"].startswith("naca_-10-") for name in ("CONV", "RESTART", "VOLUME", "SURFACE"))
    assert options(written(kinds={**KINDS, "symmetry": "far"}))["MARKER_SYM"] == "( NONE )"


def test_moments_on_a_moving_surface_are_about_its_hinge():
    """SU2 takes an origin for each marker of MARKER_MONITORING, in its order, or one for all."""
    found = options(written())
    origins = np.array([[float(word) for word in words(found[f"REF_ORIGIN_MOMENT_{axis}"])] for axis in "XYZ"]).T
    assert np.array_equal(origins, [SETUP.point, FLAP.point])
    alone = options(written(Setup()))
    assert [alone[f"REF_ORIGIN_MOMENT_{axis}"] for axis in "XYZ"] == ["0.0"] * 3


def test_the_comment_says_how_the_hinge_moment_follows():
    text = written()
    factor = 0.5 * 1.4 * 5e4 * 0.7**2 * 2.0 * 0.5
    assert f"Hinge moment of flap, right-handed about (0, 1, 0): {factor:.9g} N m times\n%     1 * CMy(flap)\n" in text
    swept = Hinge.through("tip", ["flap", "wing"], np.array([[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]))
    lines = "%     0.6 * CMx(flap)\n%   + 0.8 * CMy(flap)\n%   + 0.6 * CMx(wing)\n%   + 0.8 * CMy(wing)\n"
    assert lines in written(Setup(hinges=(swept,)))


def test_names_that_su2_would_not_read_are_refused():
    with pytest.raises(InputError, match=r"my wing\.su2: SU2 reads no name of a file with blanks"):
        check_name(Path("my wing.su2"))
