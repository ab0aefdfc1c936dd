"""Deflect the flap of Gmsh's NACA wing: any mesh, from Python.

Run `python naca_wing.py && python deflect_naca.py naca.msh`.
"""

import sys
from pathlib import Path

import sdm_deflect as sd

source = Path(sys.argv[1] if len(sys.argv) > 1 else "naca.msh")
hinge = [[0.7, 0.6, 0.0], [0.7, 1.4, 0.0]]

mesh = sd.read(source)
result = sd.deflect(
    mesh, "flap", hinge, angle=15.0, motion="blended", fixed="wing", slide={"symmetry": "plane"}, tolerance=1e-4
)
for check in result.checks:
    print(f"{check.name}: {check.value:.3g} ({check.judgement} {check.limit:.3g}), {check.verdict}")
result.save(source.with_stem("naca-15"))
