"""Components of OpenMDAO: coordinates of nodes by the amounts of surfaces, or by the places of a surface's nodes.

They run in any number of processes; each gives the nodes that it holds. Variables have the tags of MPhys, so that its
groups promote them.
"""

import re
from typing import Any

import numpy as np

try:
    import openmdao.api as om
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(f"{error}: in your clone, pip install '.[openmdao]'", name=error.name) from None

from sdm_deflect.base.arrays import FloatArray, IntArray
from sdm_deflect.base.errors import InputError
from sdm_deflect.deform.volume.boundary import ZERO_LENGTH

UNFIT = re.compile(r"[.*?!\[\]]")
"""Letters that OpenMDAO refuses in names."""
# Tags by which groups of MPhys promote variables: design variables, coordinates before and within a coupling.
DESIGN, INITIAL, COUPLING = "mphys_input", "mphys_coordinates", "mphys_coupling"


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

    _tag = COUPLING

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("plan", recordable=False, desc="plan of sdm_deflect.plan")
        self.options.declare("points", default=None, recordable=False, desc="undeflected coordinates of this process")
        self.options.declare("output", default="x", types=str, desc="name of the output")

    def setup(self) -> None:
        """Add an input for each surface, and the output."""
        plan, points, self._output = self.options["plan"], self.options["points"], self.options["output"]
        self._motion = plan if points is None else plan.on(_rows(points))
        self._names = [UNFIT.sub("_", control.name) for control in plan.controls]
        for name, control in zip(self._names, plan.controls, strict=True):
            unit = "deg" if control.unit == "deg" else None
            self.add_input(name, 0.0, units=unit, desc=control.name, tags=[DESIGN])
        start = self._motion.at(dict.fromkeys((control.name for control in plan.controls), 0.0))
        self.add_output(self._output, start.ravel(), distributed=self.comm.size > 1, tags=[self._tag])

    def compute(self, inputs: Any, outputs: Any) -> None:
        """Set the coordinates."""
        amounts = self._amounts(inputs)
        try:
            outputs[self._output] = self._motion.at(amounts).ravel()
        except InputError as error:
            raise om.AnalysisError(str(error)) from None
        if faults := self._faults(amounts):
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

    def _faults(self, amounts: tuple[float, ...]) -> tuple[str, ...]:
        return tuple(self.options["plan"].faults(amounts))


class Hinges(Warp):
    """Places of a surface's points by the amounts of the plan's surfaces: the geometry before a `SurfaceWarp`.

    Options
    -------
    plan : A plan of `sdm_deflect.plan` or `MeshMotion.load`.
    points : (n, 3) or (3n,) undeflected places of the surface's points in this process, such as `start` of a map.
    output : Name of the output.

    Raises openmdao.api.AnalysisError for an amount outside its range.
    """

    _tag = INITIAL

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("plan", recordable=False, desc="plan of sdm_deflect.plan")
        self.options.declare("points", recordable=False, desc="undeflected places of the surface's points")
        self.options.declare("output", default="x_aero0", types=str, desc="name of the output")

    def _faults(self, amounts: tuple[float, ...]) -> tuple[str, ...]:
        """Return none: the plan measured its own mesh, and a map makes another."""
        del amounts
        return ()


class SurfaceWarp(om.ExplicitComponent):
    """Coordinates of nodes by the places of a surface's nodes, and their derivatives both ways.

    The input has the places (3n,) of the surface's points, the output the coordinates (3N,) of the nodes; of several
    processes each has its own. A point belongs to the nodes at its undeflected place. Of several points at one place
    the first counts, and the others must move with it. Points that are no nodes of the map's surface must stay.

    Options
    -------
    map : A map of `sdm_deflect.surface_map`.
    points : (N, 3) or (3N,) undeflected coordinates of the nodes of this process; those of the map's mesh if None.
    start : (n, 3) or (3n,) undeflected places of this process's points; if None those of the map, in the first process.
    surface, output : Names of input and output; in a coupled scenario of MPhys the surface is ``x_aero``.
    check : Whether the first process judges each mesh.

    Raises openmdao.api.AnalysisError for a surface that the map refuses, or if a check of the mesh fails.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("map", recordable=False, desc="map of sdm_deflect.surface_map")
        self.options.declare("points", default=None, recordable=False, desc="undeflected coordinates of this process")
        self.options.declare("start", default=None, recordable=False, desc="undeflected places of the surface's points")
        self.options.declare("surface", default="x_aero0", types=str, desc="name of the input")
        self.options.declare("output", default="aero_vol_coords", types=str, desc="name of the output")
        self.options.declare("check", default=True, types=bool, desc="whether each mesh is judged")

    def setup(self) -> None:
        """Match the surface's points with the map's nodes, and add input and output."""
        whole, points, start = self.options["map"], self.options["points"], self.options["start"]
        self._map = whole if points is None else whole.on(_rows(points))
        if start is None:
            start = whole.start if self.comm.rank == 0 else np.zeros((0, 3))
        own, several = _rows(start), self.comm.size > 1
        counts = self.comm.allgather(len(own)) if several else [len(own)]
        begin = sum(counts[: self.comm.rank])
        self._own, self._start = slice(begin, begin + len(own)), self._gathered(own)
        self._row, self._lead = _matched(self._start, whole.start, whole.nodes)
        self._still = ~np.isin(self._lead, self._row)
        shape = {"distributed": several, "tags": [COUPLING]}
        self.add_input(self.options["surface"], own.ravel(), **shape)
        self.add_output(self.options["output"], self._map.at(whole.start).ravel(), **shape)

    def compute(self, inputs: Any, outputs: Any) -> None:
        """Set the coordinates."""
        try:
            surface = self._surface(inputs)
            outputs[self.options["output"]] = self._map.at(surface).ravel()
        except InputError as error:
            raise om.AnalysisError(str(error)) from None
        failed = ""
        if self.options["check"] and self.comm.rank == 0:
            checks = (check for check in self.options["map"].check(surface) if not check.passed)
            failed = "; ".join(f"{check.name} is {check.value:.3g}, limit {check.limit:.3g}" for check in checks)
        if failed := self.comm.bcast(failed) if self.comm.size > 1 else failed:
            raise om.AnalysisError(failed)

    def compute_jacvec_product(self, inputs: Any, d_inputs: Any, d_outputs: Any, mode: str) -> None:
        """Add the derivative along speeds of the surface, or that of a function by the surface's places."""
        surface, output = self.options["surface"], self.options["output"]
        if output not in d_outputs or surface not in d_inputs:
            return
        if mode == "fwd":
            speeds = self._gathered(_rows(d_inputs[surface]))[self._row]
            d_outputs[output] += self._map.jvp(self._surface(inputs), speeds).ravel()
            return
        by_node = self._map.vjp(self._surface(inputs), _rows(d_outputs[output]))
        by_point = np.zeros_like(self._start)
        np.add.at(by_point, self._row, self.comm.allreduce(by_node) if self.comm.size > 1 else by_node)
        d_inputs[surface] += by_point[self._own].ravel()

    def _surface(self, inputs: Any) -> FloatArray:
        """Return the places (K, 3) of the map's nodes; InputError for a point that should have stayed or followed."""
        places = self._gathered(_rows(inputs[self.options["surface"]]))
        expected = np.where(self._still[:, None], self._start, places[self._lead])
        off = np.linalg.norm(places - expected, axis=1)
        if len(far := np.flatnonzero(off > ZERO_LENGTH * float(np.ptp(self._start, axis=0).max()))):
            at, name = int(far[0]), self.options["surface"]
            fault = "is no node of the map's surface" if self._still[at] else f"was at the place of {self._lead[at]}"
            raise InputError(f"{name}: {len(far)} points are off, such as {at}, which {fault}, by {off[at]:.3g}")
        return np.asarray(places[self._row])

    def _gathered(self, own: FloatArray) -> FloatArray:
        """Join the rows of all processes."""
        return np.concatenate(self.comm.allgather(own)) if self.comm.size > 1 else own


def _rows(values: Any) -> FloatArray:
    return np.asarray(values, dtype=np.float64).reshape(-1, 3)


def _matched(points: FloatArray, places: FloatArray, nodes: IntArray) -> tuple[IntArray, IntArray]:
    """Return for each node (K,) the first point (n, 3) at its place, and for each point (n,) the first at its own.

    InputError for a node without a point.
    """
    _, first, group = np.unique(np.vstack([points, places]) + 0.0, axis=0, return_index=True, return_inverse=True)
    lead = first[group.ravel()]
    row = lead[len(points) :]
    if len(lost := np.flatnonzero(row >= len(points))):
        at = ", ".join(f"{x:.10g}" for x in places[lost[0]])
        raise InputError(
            f"start: {len(lost)} of the map's {len(places)} nodes have no point at their place, such as node "
            f"{nodes[lost[0]]} at {at}; give undeflected places with all digits, in the mesh's unit of length"
        )
    return row, lead[: len(points)]
