"""Deflect the flap of Gmsh's NACA wing: any mesh, from Python.

Run `python naca_wing.py && python deflect_naca.py naca.msh`.
"""

import sys
from pathlib import Path

from sdm_deflect.cases.api import deflect
from sdm_deflect.deform.surface.blended import Blended
from sdm_deflect.deform.surface.motions import Rotation
from sdm_deflect.meshing.formats.registry import format_of

source = Path(sys.argv[1] if len(sys.argv) > 1 else "naca.msh")
hinge = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]
mesh = format_of(source).read(source)

result = deflect(
    mesh, surfaces=["flap"], hinge=hinge, angle=15.0, fixed=["wing"], slide={"symmetry": "plane"},
    motion=Blended(Rotation.about(*hinge)),
)  # fmt: skip

for check in result.checks:
    print(f"{check.name}: {check.value:.3g} (limit {check.limit:.3g}), {'passed' if check.passed else 'FAILED'}")
format_of(source).rewrite(source, result.points, source.with_stem("naca-15"))
