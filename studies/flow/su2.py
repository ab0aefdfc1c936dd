"""Configurations of SU2: inviscid, steady, implicit, with the markers of the mesh that stands beside."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from sdm_deflect.base.errors import InputError
from studies.flow.setup import Hinge, Kind, Setup

CONFIG = """% Written by sdm-deflect. Run: SU2_CFD {config}; in parallel: mpirun -np 2 SU2_CFD {config}
%
{notes}%
% ------------------- problem -------------------
SOLVER= EULER
MATH_PROBLEM= DIRECT
RESTART_SOL= NO
%
% ------------------- free stream: SI units; the sideslip of SU2 turns the wind towards +y -------------------
MACH_NUMBER= {mach}
AOA= {alpha}
SIDESLIP_ANGLE= {beta}
INIT_OPTION= TD_CONDITIONS
FREESTREAM_OPTION= TEMPERATURE_FS
FREESTREAM_PRESSURE= {pressure}
FREESTREAM_TEMPERATURE= {temperature}
REF_DIMENSIONALIZATION= FREESTREAM_PRESS_EQ_ONE
FLUID_MODEL= STANDARD_AIR
%
% ------------------- reference values: an origin of moments for each marker of MARKER_MONITORING -------------------
REF_ORIGIN_MOMENT_X= {x}
REF_ORIGIN_MOMENT_Y= {y}
REF_ORIGIN_MOMENT_Z= {z}
REF_LENGTH= {length}
REF_AREA= {area}
%
% ------------------- markers -------------------
MARKER_EULER= {wall}
MARKER_FAR= {far}
MARKER_SYM= {symmetry}
MARKER_PLOTTING= {wall}
MARKER_MONITORING= {wall}
%
% ------------------- numerics -------------------
NUM_METHOD_GRAD= WEIGHTED_LEAST_SQUARES
CONV_NUM_METHOD_FLOW= JST
JST_SENSOR_COEFF= ( 0.5, 0.02 )
TIME_DISCRE_FLOW= EULER_IMPLICIT
CFL_NUMBER= 10
CFL_ADAPT= NO
LINEAR_SOLVER= FGMRES
LINEAR_SOLVER_PREC= ILU
LINEAR_SOLVER_ERROR= 1E-6
LINEAR_SOLVER_ITER= 10
MGLEVEL= 0
%
% ------------------- end -------------------
ITER= {iterations}
CONV_FIELD= RMS_DENSITY
CONV_RESIDUAL_MINVAL= -8
CONV_STARTITER= 10
%
% ------------------- files -------------------
MESH_FILENAME= {stem}.su2
MESH_FORMAT= SU2
TABULAR_FORMAT= CSV
CONV_FILENAME= {stem}-history
RESTART_FILENAME= {stem}-restart
VOLUME_FILENAME= {stem}-flow
SURFACE_FILENAME= {stem}-surface
OUTPUT_FILES= ( RESTART, PARAVIEW, SURFACE_PARAVIEW )
SCREEN_OUTPUT= ( INNER_ITER, RMS_DENSITY, RMS_ENERGY, LIFT, DRAG )
HISTORY_OUTPUT= ( ITER, RMS_RES, AERO_COEFF, AERO_COEFF_SURF )
"""
# What SU2 does not read in the name of a file.
UNFIT = frozenset(" \t%,()=")
COUNTED = """% SU2 writes coefficients. A force is {pressure:.9g} N times CFx, CFy, CFz: dynamic pressure * REF_AREA.
% A moment is {moment:.9g} N m times CMx, CMy, CMz: that times REF_LENGTH.
"""
ABOUT_HINGE = """% Hinge moment of {name}, right-handed about ({axis}): {moment:.9g} N m times
%     {sum}
% of the columns of {stem}-history.csv. These are moments about a point of its hinge, as
% REF_ORIGIN_MOMENT_X, _Y and _Z have it; CMx, CMy and CMz of no marker add up moments about different points.
"""


def configuration(kinds: Mapping[str, Kind], mesh: Path, setup: Setup) -> str:
    """Return the configuration for a mesh file, as text.

    Parameters
    ----------
    kinds : what each marker is, by its name in the file.
    mesh : the file, which the configuration stands beside and names, as it does what SU2 is to write.
    setup : the flow; `Setup.settling` has no meaning for SU2.
    """
    stream, walls = setup.stream, [name for name, kind in kinds.items() if kind == "wall"]
    moment = stream.dynamic_pressure * setup.area * setup.length
    notes = [COUNTED.format(pressure=stream.dynamic_pressure * setup.area, moment=moment)]
    notes += [_about(hinge, moment, mesh.stem) for hinge in setup.hinges]
    x, y, z = (_numbers(column) for column in np.transpose(_origins(walls, setup)))
    markers = {
        kind: _markers([name for name, own in kinds.items() if own == kind]) for kind in ("wall", "far", "symmetry")
    }
    return CONFIG.format(
        config=f"{mesh.stem}.cfg", stem=mesh.stem, notes="".join(notes), mach=_number(stream.mach),
        alpha=_number(stream.alpha), beta=_number(-stream.beta), pressure=_number(stream.pressure),
        temperature=_number(stream.temperature), x=x, y=y, z=z, length=_number(setup.length), area=_number(setup.area),
        iterations=setup.iterations, **markers,
    )  # fmt: skip


def check_name(mesh: Path) -> None:
    """Refuse the name of a file that SU2 would not read, with an InputError."""
    if UNFIT & set(mesh.name):
        raise InputError(f"{mesh}: SU2 reads no name of a file with blanks or any of % , ( ) =; choose another")


def _origins(walls: Sequence[str], setup: Setup) -> list[tuple[float, float, float]]:
    """Return the origin of the moments on each wall: on its hinge if it has one; a single one if no wall has."""
    points = {name: hinge.point for hinge in setup.hinges for name in hinge.patches}
    return [points.get(name, setup.point) for name in walls] if points else [setup.point]


def _about(hinge: Hinge, moment: float, stem: str) -> str:
    terms = [
        f"{value:.9g} * CM{letter}({name})"
        for name in hinge.patches
        for letter, value in zip("xyz", hinge.axis, strict=True)
        if value
    ]
    axis = ", ".join(f"{value:.9g}" for value in hinge.axis)
    return ABOUT_HINGE.format(name=hinge.name, axis=axis, moment=moment, sum="\n%   + ".join(terms), stem=stem)


def _markers(names: Sequence[str]) -> str:
    return f"( {', '.join(names or ['NONE'])} )"


def _numbers(values: Sequence[float]) -> str:
    words = [_number(value) for value in values]
    return words[0] if len(words) == 1 else f"( {', '.join(words)} )"


def _number(value: float) -> str:
    return repr(float(value) + 0.0)
