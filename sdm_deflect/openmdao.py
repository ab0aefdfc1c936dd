"""A plan as a component of OpenMDAO: from amounts of surfaces to coordinates of nodes.

The component runs in any number of processes; each gives the nodes that it holds.
"""

import re
from typing import Any

import numpy as np

try:
    import openmdao.api as om
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(f"{error}: in your clone, pip install '.[openmdao]'", name=error.name) from None

from sdm_deflect.base.errors import InputError

UNFIT = re.compile(r"[.*?!\[\]]")
"""Letters that OpenMDAO refuses in names."""


class Warp(om.ExplicitComponent):
    """Coordinates of nodes by the amounts of the plan's surfaces, and their derivatives both ways.

    There is an input for each surface. It has the surface's name, with ``_`` for letters such as ``*``; the unit is
    degrees for a hinge. The output has the coordinates (3N,) of the points; of several processes each has its own.

    Options
    -------
    plan : A plan of `sdm_deflect.plan` or `MeshMotion.load`.
    points : (N, 3) or (3N,) undeflected coordinates of the nodes of this process; those of the plan's mesh if None.
    output : Name of the output, such as ``aero_vol_coords``.

    Raises openmdao.api.AnalysisError for an amount outside its range, or one at which a check of the mesh failed.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("plan", recordable=False, desc="plan of sdm_deflect.plan")
        self.options.declare("points", default=None, recordable=False, desc="undeflected coordinates of this process")
        self.options.declare("output", default="x", types=str, desc="name of the output")

    def setup(self) -> None:
        """Add an input for each surface, and the output."""
        plan, points, self._output = self.options["plan"], self.options["points"], self.options["output"]
        own = None if points is None else np.asarray(points, dtype=np.float64).reshape(-1, 3)
        self._motion = plan if own is None else plan.on(own)
        self._names = [UNFIT.sub("_", control.name) for control in plan.controls]
        for name, control in zip(self._names, plan.controls, strict=True):
            self.add_input(name, 0.0, units="deg" if control.unit == "deg" else None, desc=control.name)
        start = self._motion.at(dict.fromkeys((control.name for control in plan.controls), 0.0))
        self.add_output(self._output, start.ravel(), distributed=self.comm.size > 1)

    def compute(self, inputs: Any, outputs: Any) -> None:
        """Set the coordinates."""
        amounts, plan = self._amounts(inputs), self.options["plan"]
        try:
            outputs[self._output] = self._motion.at(amounts).ravel()
        except InputError as error:
            raise om.AnalysisError(str(error)) from None
        if faults := plan.faults(amounts):
            raise om.AnalysisError("; ".join(faults))

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str) -> None:
        """Add the derivative along speeds of the amounts, or that of a function by the amounts."""
        amounts, own = self._amounts(inputs), [name for name in self._names if name in d_inputs]
        if self._output not in d_outputs or not own:
            return
        if mode == "fwd":
            speeds = tuple(float(d_inputs[name][0]) if name in own else 0.0 for name in self._names)
            d_outputs[self._output] += self._motion.jvp(amounts, speeds).ravel()
            return
        rates = self._motion.vjp(amounts, d_outputs[self._output].reshape(-1, 3))
        rates = self.comm.allreduce(rates) if self.comm.size > 1 else rates
        for name in own:
            d_inputs[name] += rates[self._names.index(name)]

    def _amounts(self, inputs: Any) -> tuple[float, ...]:
        return tuple(float(inputs[name][0]) for name in self._names)
