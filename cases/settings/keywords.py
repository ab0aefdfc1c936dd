"""Settings of a deflection as typed keywords, generated from the schema by `python -m tests.derived`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypedDict

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    from sdm_deflect.deform.box.automatic import BoxRule
    from sdm_deflect.deform.box.hexahedron import Hexahedron
    from sdm_deflect.deform.surface.motions import Motion
    from sdm_deflect.deform.surface.surface import NodeSet
    from sdm_deflect.deform.surface.tables import Table


class Options(TypedDict, total=False):
    """What `deflect`, `sweep` and `plan` take beside the mesh, the surfaces, the hinge and the angle."""

    device: ArrayLike
    down: float
    up: float
    vertical: Literal["y", "z"]
    range: ArrayLike
    motion: Literal["rigid", "blended", "root"] | Motion
    held: ArrayLike | NodeSet
    driven: ArrayLike | NodeSet
    strip: float
    on: str | Sequence[str]
    shape: Literal["skin", "cylinder"]
    depth: float
    panel: float
    table: str | PathLike[str] | Table | tuple[ArrayLike, ArrayLike]
    to: str | Sequence[str] | PathLike[str] | ArrayLike
    largest: float
    shift: ArrayLike
    track: str | PathLike[str]
    slot: str
    gap: float
    overlap: float
    mirror: str | Sequence[str]
    sign: int
    box: str | PathLike[str] | ArrayLike | BoxRule | Hexahedron
    fixed: str | Sequence[str]
    zones: str | Sequence[str]
    near_wall: bool
    allow_inverted: bool
    force: bool
    select: str | Sequence[str] | Mapping[str, str]
    slide: str | Sequence[str] | Mapping[str, str]
    periodic: Mapping[str, Any] | Sequence[Any]
    margin: float
    box_each: bool
    open_faces: str | Sequence[str]
    section: Sequence[Mapping[str, Any]]
    repair_slide: str | Sequence[str] | Mapping[str, str]
    strategy: Literal["squv", "mv"]
    tolerance: float
    initial_surface: int
    initial_hexahedron: int
    n_add: int
    max_centers: int
    rule: Literal["separated", "worst"]
    spacing: float
    spacing_edges: float
    max_steps: int
    kernel: Literal["tps", "mq", "wendland", "cubic"]
    kernel_radius: float
    polynomial: Literal["linear", "constant", "none"]
    processor: Literal["cpu", "gpu"]
    repair: Literal["auto", "off", "always"]
    repair_share: float
    min_quality: float
