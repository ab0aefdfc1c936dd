"""The volume mesh as a function of its surface: coordinates for any places of the surface's nodes, and derivatives.

One step of the engine on centres that never change: farthest points of the boundary and of the box. So the map is the
same function for every shape, and its derivatives are exact. Known nodes are met exactly, whether or not they are
centres. Near walls the mesh follows them over the largest gap between centres.
"""

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from sdm_deflect.base.arrays import FloatArray, IntArray, farthest, first_coincident
from sdm_deflect.base.errors import InputError, shortened
from sdm_deflect.base.threads import Progress, silent
from sdm_deflect.base.ties import first_largest
from sdm_deflect.meshing.mesh.cells import bounded
from sdm_deflect.meshing.mesh.mesh import Mesh

from .checks import Check, checks_of
from .confined import GROUPINGS, Choice, Confined
from .mesh_motion import MeshMotion
from .rbf.greedy import Adaptation, adapt, fuse
from .rbf.rules import GreedyOptions
from .surface.motions import Moving
from .surface.placement import TablePlacement
from .surface.tables import Table, TableLaw
from .volume.controls import ControlRange
from .volume.deflection import BoxDeflection, Deflection
from .volume.job import Job
from .volume.places import PlaceTable
from .volume.plan import BoxPlan, Plan
from .volume.snapshots import Snapshots
from .volume.step import Start, Step, sites_of, take
from .volume.step_rates import StepRates

# Numbers of centres on the boundary and on the box. Fewer bend the mesh less like the surface: with 300 and 150 a short
# wave on a wing tip gives a least quality of .38 for .55. Greedy centres have a condition of 5e10, which spoils the
# transpose.
CENTERS = (1500, 300)


@dataclass(frozen=True, eq=False, repr=False)
class SurfaceMap:
    """Coordinates of a mesh as a function of the places of its surface's nodes.

    Attributes
    ----------
    plan : known nodes, box and sites.
    begin : the undeflected mesh as the start of a step; its free nodes are those that this map moves.
    first, last : the fits for bound and for free nodes; `first` is None without bound nodes.
    coordinates : (N, 3) undeflected coordinates of the points that this map moves.
    rows, nodes_of : (M,) rows of `coordinates` that may move, and the node of the plan's mesh at each.
    """

    plan: Plan = field(repr=False)
    begin: Start = field(repr=False)
    first: Confined | None = field(repr=False)
    last: Confined = field(repr=False)
    coordinates: FloatArray = field(repr=False)
    rows: IntArray = field(repr=False)
    nodes_of: IntArray = field(repr=False)

    @classmethod
    def of(
        cls, mesh: Mesh, job: Job, whole: FloatArray | None = None, centers: tuple[int, int] = CENTERS,
        progress: Progress = silent,
    ) -> "SurfaceMap":  # fmt: skip
        """Plan a job with one surface of the motion `AnyShape`, and factorise the fits.

        `whole` (N, 3) are the coordinates of the file if the mesh is a submesh of it. Raises InputError if the job does
        not suit the mesh.
        """
        plan = Plan.of(mesh, [job], (), progress)
        box = plan.boxes[0]
        progress("centres", 0.0)
        how = _how(box, centers)
        begin = _start(box, how)
        first, last = (_fit(begin, is_last) for is_last in (False, True))
        box = replace(box, gap=max(_gap(box, begin, fits) for fits in (first, last) if fits))
        plan = replace(plan, boxes=(box,))
        assert last
        movable, coordinates = box.movable, plan.mesh.points if whole is None else whole
        return cls(plan, _start(box, how), first, last, coordinates, plan.mesh.numbers(movable), movable)

    def __repr__(self) -> str:
        names, mesh = ", ".join(self.plan.patches), self.plan.mesh.name
        moves = f"{len(self.rows)} of {len(self.coordinates)} points"
        return f"<SurfaceMap: {names} of {mesh}, {len(self.nodes)} nodes; moves {moves}>"

    @property
    def box(self) -> BoxPlan:
        """The plan of the only box."""
        return self.plan.boxes[0]

    @property
    def nodes(self) -> IntArray:
        """Indices (K,) in the file of the surface's nodes, rising."""
        return self.plan.mesh.numbers(self.box.sites.moving)

    @property
    def start(self) -> FloatArray:
        """Undeflected places (K, 3) of the surface's nodes."""
        return self.plan.mesh.points[self.box.sites.moving]

    def at(self, surface: ArrayLike) -> FloatArray:
        """Return the coordinates (N, 3) for places (K, 3) of the surface's nodes; at `start` they are the mesh's.

        Raises InputError for places of another shape or not finite, or if a node would leave a patch that it shares.
        """
        return self._scattered(self._step(self._admitted(surface)).points)

    def jvp(self, surface: ArrayLike, speeds: ArrayLike) -> FloatArray:
        """Return the derivative (N, 3) of the coordinates along speeds (K, 3) of the surface's nodes."""
        given, rates = self._rates(surface)
        moving = self.box.boundary.admitted_rate(given, self._checked(speeds, "speeds"))
        return self._scattered(rates.forward(moving, self.box.runner), np.zeros_like(self.coordinates))

    def vjp(self, surface: ArrayLike, gradient: ArrayLike) -> FloatArray:
        """Return the gradient (K, 3) by the surface's places of a function whose gradient by the coordinates is (N, 3).

        Raises InputError as `at`, or for a gradient of another shape.
        """
        by_point = bounded(gradient, "gradient")
        if by_point.shape != self.coordinates.shape:
            raise InputError(f"gradient {by_point.shape} must be {self.coordinates.shape}, one row for each point")
        given, rates = self._rates(surface)
        by_node = np.zeros_like(self.begin.points)
        np.add.at(by_node, self.nodes_of, by_point[self.rows])
        return self.box.boundary.admitted_reverse(given, rates.reverse(by_node)[: len(given)])

    def on(self, points: ArrayLike) -> "SurfaceMap":
        """Return the map of undeflected points (N, 3): all nodes of the mesh, or any part of them in any order.

        A part has the bits of the whole. Raises InputError as `MeshMotion.on`.
        """
        given = bounded(points, "points")
        if given.ndim != 2 or given.shape[1] != 3:
            raise InputError(f"points {given.shape} must be (N, 3)")
        table, nodes, place = self._places
        at = table.find(given)
        table.check(given, at)
        rows = np.flatnonzero(at >= 0)
        node = np.full(len(table.places), -1, dtype=np.intp)
        node[place[::-1]] = nodes[::-1]  # the first node at each place
        moved = node[at[rows]]
        kept = np.isin(moved, self.box.movable)
        rows, moved = rows[kept], moved[kept]
        images = self.box.boundary.images
        wanted = images.closure(np.unique(moved), len(self.plan.mesh.points)) if len(images.nodes) else np.unique(moved)
        free = np.intersect1d(self._free, wanted, assume_unique=True)
        return replace(self, begin=_start(self.box, self.begin.how, free), coordinates=given, rows=rows, nodes_of=moved)

    def check(self, surface: ArrayLike) -> tuple[Check, ...]:
        """Return the checks of a deflection, made of the whole mesh at this surface.

        The error at data sites has no limit: boundary nodes are met exactly, and quality judges the rest.
        """
        move = self._admitted(surface)
        step = self._step(move, _start(self.box, self.begin.how))
        boundary = self.box.boundary
        law = TableLaw(move[np.searchsorted(boundary.nodes, boundary.surfaces[0].nodes)])
        box = replace(self.box, boundary=replace(boundary, laws=(law,), known={(1.0,): move}))
        plan = replace(self.plan, boxes=(box,))
        deflection = BoxDeflection(box, (1.0,), (step,), box.to_whole_mesh(step.points), 0.0, residual=step.correction)
        checks = checks_of(Deflection(plan, (deflection,)))
        return tuple(
            replace(check, judgement="information") if check.name.startswith("site_error") else check
            for check in checks
        )

    def modes(self, shapes: Mapping[str, ArrayLike | Table], ends: tuple[float, float] = (-1.0, 1.0)) -> MeshMotion:
        """Return a plan with an amount for each mode of a structure; the mesh follows their sum to first order.

        The surface is exact at all amounts. The plan answers for the map's points, as `MeshMotion.on`.

        Parameters
        ----------
        shapes : For each name the displacement (K, 3) of the surface's nodes at amount 1, or a `Table`. Rotations of a
            table count to first order, too: a node moves by u + r x (x - p) times the amount.
        ends : The least and the largest amount of each mode.

        Warns as `deflect` of tables. Raises InputError without shapes, for one that is 0 or that `at` would refuse at
        an end, for a table that `deflect` would refuse, or for ends without 0.
        """
        low, high = _ends(ends)
        vectors = self._modes(shapes, (low, high))
        box, mesh = self.box, self.plan.mesh
        for name, shape in shapes.items():
            for text in self._doubts(shape, vectors[name]) if isinstance(shape, Table) else ():
                warnings.warn(f"{name}: {text}", stacklevel=2)
        moving = tuple(Moving(box.patches, Table(self.start, shape), 0.0, (low, high)) for shape in vectors.values())
        laws = tuple(map(TableLaw, vectors.values()))
        surfaces = tuple(replace(box.boundary.surfaces[0], number=1 + i) for i in range(len(laws)))
        boundary = replace(box.boundary, job=replace(box.job, surfaces=moving), surfaces=surfaces, laws=laws)
        with_modes, at = replace(box, boundary=boundary), max(low, high, key=abs)
        rates, fields, snapshots = self._rates(self.start, _start(box, self.begin.how))[1], [], []
        for i, (name, shape) in enumerate(vectors.items()):
            move = rates.forward(box.boundary.admitted_rate(np.zeros_like(shape), shape), box.runner)
            pose = tuple(at * (i == j) for j in range(len(laws)))
            there = BoxDeflection(with_modes, pose, (), mesh.points + at * move, 0.0, residual=0.0)
            control = ControlRange(name, box.patches, Table.unit, low, high, laws[i].functions)
            read = Snapshots(control, with_modes, i, (there,), np.array([[1.0 / at]]), (there,))
            snapshots.append(read.with_residuals())
            fields.append(move[None, box.movable])
        rest = (0.0,) * len(laws)
        plan = replace(self.plan, boxes=(with_modes,), poses=(rest,))
        motion = MeshMotion(
            tuple(snapshot.control for snapshot in snapshots), mesh.points, (box.movable,) * len(laws), tuple(fields),
            rest, source=Path(mesh.source).name, plan=plan, snapshots=tuple(snapshots),
        )  # fmt: skip
        return motion if self.coordinates is mesh.points else motion.on(self.coordinates)

    def _modes(self, shapes: Mapping[str, ArrayLike | Table], ends: tuple[float, float]) -> dict[str, FloatArray]:
        """Return the displacements (K, 3) by name; InputError as `modes`."""
        if not isinstance(shapes, Mapping) or not shapes or not all(isinstance(name, str) and name for name in shapes):
            raise InputError(f"shapes = {shortened(shapes)} must be displacements (K, 3) by name")
        surface = self.box.boundary.surfaces[0]
        vectors = {}
        for name, shape in shapes.items():
            if isinstance(shape, Table):
                TablePlacement.of(surface, shape).check(surface, force=False)
                shape = shape.law(surface).slope
            vectors[name] = self._checked(shape, name)
        for name, shape in vectors.items():
            if not shape.any():
                raise InputError(f"{name} moves no node")
        for shape, end in product(vectors.values(), filter(None, ends)):
            self._admitted(self.start + end * shape)
        return vectors

    def _doubts(self, table: Table, moved: FloatArray) -> Iterator[str]:
        """Yield warnings about a table that moves the surface's nodes by `moved` (K, 3)."""
        boundary = self.box.boundary
        placement = replace(TablePlacement.of(boundary.surfaces[0], table), moved=moved)
        yield from placement.warnings(blended=False)
        yield from boundary.moved_roots(placement, boundary.surfaces[0])

    @cached_property
    def _free(self) -> IntArray:
        """Sorted free nodes of the whole mesh."""
        return np.setdiff1d(self.box.region.inside, self.box.sites.known, assume_unique=True)

    @cached_property
    def _places(self) -> tuple[PlaceTable, IntArray, IntArray]:
        return PlaceTable.of(self.plan)

    def _checked(self, values: ArrayLike, what: str) -> FloatArray:
        given = bounded(values, what)
        if given.shape != (len(self.nodes), 3):
            raise InputError(
                f"{what} {given.shape} must be ({len(self.nodes)}, 3), one row for each node of the surface"
            )
        return given

    def _displacement(self, surface: ArrayLike) -> FloatArray:
        return self._checked(surface, "surface") - self.start

    def _admitted(self, surface: ArrayLike) -> FloatArray:
        """Return the displacement (K, 3) of the surface's nodes; InputError if coincident nodes would part."""
        move = self.box.boundary.admitted(self._displacement(surface))
        first = self._first_there
        torn = np.flatnonzero((move != move[first]).any(axis=1))
        if len(torn):
            pair = self.nodes[[first[torn[0]], torn[0]]].tolist()
            raise InputError(f"surface: {len(torn)} nodes part from others at their place, such as nodes {pair}")
        return move

    @cached_property
    def _first_there(self) -> IntArray:
        """For each node of the surface the first one at its place."""
        return first_coincident(self.start)

    def _step(self, move: FloatArray, begin: Start | None = None) -> Step:
        """Return the engine's step for a displacement (K, 3)."""
        begin = begin or self.begin
        known = np.zeros((len(begin.known), 3))
        earlier = Step(begin, self.first, self.last, known, known, begin.points, 0.0)
        return take(begin, move, earlier, keep_centers=True, runner=self.box.runner)

    def _scattered(self, places: FloatArray, whole: FloatArray | None = None) -> FloatArray:
        """Return values (N, 3) of all points, given those of the plan's nodes; others keep theirs."""
        out = np.array(self.coordinates if whole is None else whole)
        out[self.rows] = places[self.nodes_of]
        return out

    def _rates(self, surface: ArrayLike, begin: Start | None = None) -> tuple[FloatArray, StepRates]:
        """Return the displacement (K, 3) at a surface as given, and the derivative of the step there."""
        given = self._displacement(surface)
        return given, StepRates.of(begin or self.begin, self.first, self.last, self.box.boundary.admitted(given))


def _ends(given: tuple[float, float]) -> tuple[float, float]:
    """Return the least and the largest amount of modes; InputError unless 0 is among them."""
    ends = bounded(given, "ends")
    if ends.shape != (2,) or not ends[0] <= 0.0 <= ends[1] or ends[0] == ends[1]:
        raise InputError(f"ends = {shortened(given)} must be the least and the largest amount, with 0 among them")
    return float(ends[0]), float(ends[1])


def _how(box: BoxPlan, centers: tuple[int, int]) -> Choice:
    """Return the choice of common centres for all directions, as many on the boundary and on the box."""
    options = GreedyOptions(
        n_add=1, tol_add=1.0, tol_stop=1.0, max_centers=sum(centers), polynomial=box.job.fitting.polynomial
    )
    return Choice(box.sites.kernel, "mv", "separated", centers, options)


def _start(box: BoxPlan, how: Choice, free: IntArray | None = None) -> Start:
    """Return the undeflected mesh as the start of a step; `free` are the nodes to move, if not all."""
    begin = box.start(box.boundary.mesh.points)
    on_walls = np.isin(begin.rows, np.concatenate(box.parts[:-1]))
    rows = np.concatenate([begin.rows[on_walls], begin.rows[~on_walls]])
    begin = replace(begin, how=how, rows=rows, surface=int(on_walls.sum()))
    if free is None:
        return begin
    modifiers = tuple(modifier.at(begin.points, free) for modifier in box.modifiers)
    return replace(begin, free=free, modifiers=modifiers)


def _fit(begin: Start, is_last: bool) -> Confined | None:
    """Choose centres among the sites of a pass, and factorise; None for the first pass without bound nodes."""
    if not is_last and not begin.bound:
        return None
    known, how, fits = np.zeros((len(begin.known), 3)), begin.how, list[Adaptation]()
    further = [sites for modifier in begin.modifiers for sites in modifier.sites(known, is_last)]
    for group in GROUPINGS[how.strategy](sites_of(begin, known, further, is_last)):
        fits.append(adapt(group, how.kernel, spread(group.points, begin.surface, how.initial), how.options))
    return Confined(tuple(fits), fuse(fits))


def spread(points: FloatArray, walls: int, count: tuple[int, int]) -> IntArray:
    """Return rows of points (S, 3) far from one another: `count[0]` of the first `walls`, `count[1]` of others.

    The others are far from the first, too: nodes of a symmetry plane stand near walls, by the height of a layer.
    """
    first = farthest(points[:walls], count[0])
    gap, chosen = cKDTree(points[first]).query(points[walls:])[0], list[int]()
    for _ in range(min(count[1], len(gap))):
        chosen.append(first_largest(gap))
        gap = np.minimum(gap, np.linalg.norm(points[walls:] - points[walls + chosen[-1]], axis=1))
    return np.concatenate([first, walls + np.array(chosen, dtype=np.intp)])


def _gap(box: BoxPlan, begin: Start, fits: Confined) -> float:
    """Return the diameter of the largest part of the moved walls without a centre."""
    walls = np.unique(np.concatenate(box.parts[:-1]))
    walls = begin.known[walls[walls < len(begin.known) - begin.bound]]
    trees = (cKDTree(fit.interpolant.centers) for fit in fits.adaptations)
    return 2.0 * max(float(tree.query(begin.points[walls])[0].max(initial=0.0)) for tree in trees)
