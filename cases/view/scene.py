"""The objects that the browser draws: made once, then changed. Nothing is drawn here, so no OpenGL is needed here."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from trame_vtk.modules.vtk.serializers import registry  # type: ignore[import-untyped, unused-ignore]
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import VTK_ID_TYPE, VTK_UNSIGNED_CHAR, vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
from vtkmodules.vtkRenderingCore import vtkActor, vtkPolyDataMapper, vtkRenderer
from vtkmodules.vtkRenderingExternal import vtkExternalOpenGLCamera
from vtkmodules.vtkRenderingOpenGL2 import vtkGenericOpenGLRenderWindow

from sdm_deflect.cases.report.scene3d import Direction
from sdm_deflect.cases.view.pieces import ViewPiece
from sdm_deflect.deform.base.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Look:
    """How a kind of piece is drawn: colours 0 to 1, widths in pixels."""

    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)
    edge: tuple[float, float, float] | None = None
    width: float = 1.0
    ambient: float = 0.25
    opacity: float = 1.0


GROUNDS = ((1.0, 1.0, 1.0), (0.086, 0.094, 0.106))
"""Of the picture, light and dark."""
LINES = {"box": ((0.8, 0.0, 0.8), (1.0, 0.4, 1.0)), "outline": ((0.1, 0.1, 0.1), (1.0, 1.0, 1.0))}
"""Colours of what is drawn on the ground, light and dark."""
BRIGHTNESS = {"section": (1.0, 0.77), "around": (1.0, 0.77)}
"""Of what would dazzle on a dark ground, light and dark; the page's style sheet has the same for the key."""
DARK, GREY = (0.2, 0.2, 0.2), (0.62, 0.63, 0.65)
LOOKS = {
    "body": Look(edge=(0.7, 0.71, 0.73), ambient=0.45),
    "surface": Look(edge=(0.12, 0.33, 0.47), ambient=0.45),
    "around": Look(edge=GREY, ambient=1.0),
    "section": Look(edge=DARK, ambient=1.0),
    "loose": Look((0.34, 0.71, 0.91), width=4.0, ambient=1.0),
    "inverted": Look((0.84, 0.0, 0.0), (0.45, 0.0, 0.0), ambient=1.0),
    "marks": Look((0.84, 0.0, 0.0), width=9.0, ambient=1.0),
    "box": Look(LINES["box"][0], width=2.0, ambient=1.0),
    "outline": Look(LINES["outline"][0], width=1.5, ambient=1.0),
    "centres": Look((0.84, 0.37, 0.0), width=5.0, ambient=1.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class ViewScene:
    """One actor for each kind of piece, in a window that is never drawn."""

    window: Any = field(default_factory=vtkGenericOpenGLRenderWindow)
    renderer: Any = field(default_factory=vtkRenderer)
    actors: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Scenes are sent without a camera of this kind: the browser keeps its own when the mesh moves.
        registry.register_instance_serializer("vtkExternalOpenGLCamera", lambda *_: None)
        self.renderer.SetActiveCamera(vtkExternalOpenGLCamera())
        self.renderer.SetBackground(*GROUNDS[0])
        self.window.AddRenderer(self.renderer)
        for name, look in LOOKS.items():
            self.actors[name] = _actor(look)
            self.renderer.AddActor(self.actors[name])

    def show(self, pieces: Mapping[str, ViewPiece]) -> None:
        """Replace what these actors show."""
        for name, piece in pieces.items():
            self.actors[name].SetVisibility(not piece.empty)
            if not piece.empty:
                _fill(self.actors[name].GetMapper().GetInput(), piece)

    def hide(self, *names: str) -> None:
        """Show no longer what these actors show."""
        for name in names:
            self.actors[name].SetVisibility(False)

    def darken(self, dark: bool) -> None:
        """Draw on a dark ground, or on a light one."""
        self.renderer.SetBackground(*GROUNDS[dark])
        for name, colours in LINES.items():
            shown = self.actors[name].GetProperty()
            shown.SetColor(*colours[dark])
            shown.SetAmbientColor(*colours[dark])
        for name, share in BRIGHTNESS.items():
            self.actors[name].GetProperty().SetAmbient(share[dark])

    def look(self, focus: FloatArray, towards: FloatArray, height: float, up: Direction = (1.0, 0.0, 0.0)) -> None:
        """Put the eye so that a `height` around the focus (3,) fills the picture, seen from a direction (3,).

        What is `up` in the picture is said for a direction along z; else it is z.
        """
        camera = self.renderer.GetActiveCamera()
        away = towards / np.linalg.norm(towards)
        distance = 0.5 * height / np.tan(np.radians(0.5 * camera.GetViewAngle()))
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus + distance * away))
        camera.SetViewUp(*(up if abs(away[2]) > 0.9 else (0.0, 0.0, 1.0)))


def _actor(look: Look) -> Any:
    """Return an actor without content."""
    actor, mapper, data = vtkActor(), vtkPolyDataMapper(), vtkPolyData()
    mapper.SetInputDataObject(data)
    mapper.SetScalarModeToUseCellFieldData()
    mapper.SelectColorArray("rgb")
    mapper.SetColorModeToDirectScalars()
    actor.SetMapper(mapper)
    actor.SetVisibility(False)
    shown = actor.GetProperty()
    shown.SetColor(*look.colour)
    shown.SetAmbientColor(*look.colour)
    shown.SetAmbient(look.ambient)
    shown.SetDiffuse(1.0 - look.ambient)
    shown.SetOpacity(look.opacity)
    shown.SetLineWidth(look.width)
    shown.SetPointSize(look.width)
    shown.SetInterpolationToFlat()
    if look.edge is not None:
        shown.EdgeVisibilityOn()
        shown.SetEdgeColor(*look.edge)
    return actor


def _fill(data: Any, piece: ViewPiece) -> None:
    """Give a data set the points, cells and colours of a piece; single precision is what a browser draws."""
    points = vtkPoints()
    points.SetData(numpy_to_vtk(piece.points.astype(np.float32), deep=True))
    data.SetPoints(points)
    {1: data.SetVerts, 2: data.SetLines}.get(int(piece.sizes[0]), data.SetPolys)(_cells(piece))
    if piece.rgb is not None:
        colours = numpy_to_vtk(np.ascontiguousarray(piece.rgb), deep=True, array_type=VTK_UNSIGNED_CHAR)
        colours.SetName("rgb")
        data.GetCellData().SetScalars(colours)
    data.Modified()


def _cells(piece: ViewPiece) -> Any:
    offsets = np.concatenate([[0], np.cumsum(piece.sizes)]).astype(np.int64)
    cells = vtkCellArray()
    nodes = piece.nodes.astype(np.int64)
    cells.SetData(numpy_to_vtk(offsets, True, VTK_ID_TYPE), numpy_to_vtk(nodes, True, VTK_ID_TYPE))
    return cells
