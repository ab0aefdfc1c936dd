"""Deflect the flap of Gmsh's NACA wing: any mesh, from Python.

Run `python naca_wing.py && python deflect_naca.py naca.msh`.
"""

import sys
from pathlib import Path

from sdm_deflect.cases.api import deflect, read

source = Path(sys.argv[1] if len(sys.argv) > 1 else "naca.msh")

result = deflect(
    read(source),
    surfaces="flap",
    hinge=[[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]],
    angle=15.0,
    motion="blended",
    fixed="wing",
    slide={"symmetry": "plane"},
)

for check in result.checks:
    print(f"{check.name}: {check.value:.3g} (limit {check.limit:.3g}), {check.verdict}")
result.save(source.with_stem("naca-15"))
