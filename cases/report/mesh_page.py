"""The page of an undeflected mesh, whose patches can be turned and clicked."""

import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sdm_deflect.base.files import fresh, permitted_as
from sdm_deflect.cases.run.inspection import hinges_of
from sdm_deflect.deform.surface.hinges import ends_text
from sdm_deflect.meshing.mesh.mesh import Mesh

from .data import MESH_UNITS, ProposedHinge, ReportData, diagonal
from .page import HERE, picture, templates
from .scene3d import turnable

# Patches of more are thinned.
MOST_TRIANGLES = 100_000
# Mark of our pages, and the number of bytes in which it stands; the policy before it has fewer than a thousand.
MARK, BEGIN = b'<meta name="generator" content="sdm-deflect">', 1 << 12
# Patches that reach over more of the mesh are hidden at first, if others remain: they are far fields.
HALF = 0.5


def page_of(mesh: Mesh) -> str:
    """Return the page of a mesh."""
    size = {patch.name: diagonal(mesh.points[patch.nodes]) for patch in mesh.patches if len(patch.nodes)}
    near = [name for name, extent in size.items() if extent <= HALF * diagonal(mesh.points)]
    shown = tuple(near or size)
    data = ReportData(
        title=mesh.name,
        subject=mesh.name,
        facts=(),
        mesh=mesh,
        points=mesh.points,
        boxes=(),
        length=MESH_UNITS,
        settings="",
        settings_file="",
        repeat=shlex.quote(mesh.source or "MESH"),
        tables={},
        middle=mesh.points.mean(axis=0),
        drawn=shown,
        hidden=tuple(name for name in mesh.names if name not in shown),
        hinges=tuple(_hinges(mesh)),
        beside={name: tuple(_beside(mesh, name, shown)) for name in shown},
    )
    template = templates(HERE).get_template("mesh.html")
    seen = picture(data, turnable(data, most_triangles=MOST_TRIANGLES))
    return template.render(seen, cells=sum(mesh.cell_counts), patches=list(_patches(mesh)))


def _hinges(mesh: Mesh) -> Iterator[ProposedHinge]:
    """Yield the hinges that `sdm quality` proposes."""
    for name, hinges in hinges_of(mesh).items():
        for ends in hinges:
            yield ProposedHinge(name, ends_text(ends), tuple(tuple(end) for end in ends))


def _beside(mesh: Mesh, name: str, names: Sequence[str]) -> Iterator[str]:
    """Yield those of other patches that share a node with a patch: they stay, and it is blended between them."""
    own = mesh.patch(name).nodes
    return (
        other for other in names if other != name and np.isin(mesh.patch(other).nodes, own, assume_unique=True).any()
    )


def write_mesh_page(mesh: Mesh, out: Path) -> None:
    """Write the page of a mesh; MeshFileError if the file cannot be written, or exists and is no earlier page."""
    with permitted_as(mesh.source), fresh(out, *map(Path, mesh.files), earlier=is_page) as beside:
        beside.write_text(page_of(mesh), encoding="utf-8")


def is_page(path: Path) -> bool:
    """Return whether a file is a page of this program, by its mark."""
    with path.open("rb") as file:
        return MARK in file.read(BEGIN)


def _patches(mesh: Mesh) -> Iterator[tuple[str, int, int, str, str]]:
    for patch in mesh.patches:
        places = mesh.points[patch.nodes]
        ends = (places.min(axis=0), places.max(axis=0)) if len(places) else ((), ())
        low, high = (", ".join(f"{c:.5g}" for c in end) for end in ends)
        yield patch.name, len(places), len(patch), low, high
