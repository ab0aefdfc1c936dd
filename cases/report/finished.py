"""A finished run, read from its folder: what is asked of it, whether it is of a case or of any mesh."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from sdm_deflect.cases.report.data import Length, ReportData
from sdm_deflect.cases.run.output import PAGE, output_files
from sdm_deflect.deform.base.arrays import FloatArray
from sdm_deflect.deform.checks import Check
from sdm_deflect.deform.rbf.fitting import LARGEST_ANGLE
from sdm_deflect.deform.volume.plan import Plan

if TYPE_CHECKING:
    from sdm_deflect.cases.report.pictures import Exhibit


@dataclass(frozen=True, slots=True)
class Display:
    """How a run is shown.

    Attributes
    ----------
    title : what it is.
    positive : where a positive angle goes.
    length : unit of the mesh.
    hidden : patches that are not drawn.
    leading : of each surface so many patches are the surface itself, the others only follow; None: all.
    largest : degrees that no surface can exceed.
    """

    title: str
    positive: str
    length: Length
    hidden: tuple[str, ...]
    leading: int | None = None
    largest: float = LARGEST_ANGLE


@dataclass(frozen=True, slots=True, eq=False)
class FinishedRun(ABC):
    """A finished run.

    Attributes
    ----------
    folder : its files.
    plan : what was decided before the fit, from its settings and its undeflected mesh.
    points : (N, 3) where it brought the mesh.
    repair : (N, 3) how far its repair moved each node; None without one.
    """

    folder: Path
    plan: Plan = field(repr=False)
    points: FloatArray = field(repr=False)
    repair: FloatArray | None = field(repr=False)

    @property
    def angle(self) -> float:
        """Its angle: that of the first surface, unless a case has one by which all surfaces turn."""
        return self.plan.angle

    @property
    @abstractmethod
    def display(self) -> Display:
        """How it is shown."""

    @abstractmethod
    def report_data(self) -> ReportData:
        """Return what its report shows, with the checks that it made itself; InputError if a file is damaged."""

    @abstractmethod
    def validated(self) -> tuple[Check, ...]:
        """Return its checks, made again from its files, and those of the files.

        Raises InputError or MeshFileError if a file is missing or damaged, or the files do not belong together.
        """

    def judged_again(self) -> ReportData:
        """Return what a report made anew shows."""
        return self.report_data()

    def further_pictures(self, data: ReportData, folder: Path) -> "Sequence[Exhibit]":
        """Draw into `folder` what only this kind of run has."""
        return ()

    def report(self, form: str = "") -> ReportData:
        """Make report.html and the figures again, these also in a form for a paper (pdf, svg, png)."""
        from sdm_deflect.cases.report.page import write_report
        from sdm_deflect.cases.report.pictures import drawn

        data = self.judged_again()
        with output_files(self.folder, PAGE) as scratch:
            figures = scratch / "figures"
            gallery = drawn(data, figures).with_more(self.further_pictures(data, figures))
            write_report(data, gallery, scratch)
            for exhibit in gallery.exhibits if form else ():
                exhibit.write(form)
        return data
