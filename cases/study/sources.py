"""The finished runs that the figures show, each made once."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from sdm_deflect.cases.case import Case, Strategy
from sdm_deflect.cases.pipeline import meshed, run_case
from sdm_deflect.cases.progress import Display, Stopwatch
from sdm_deflect.cases.registry import case_named
from sdm_deflect.cases.run import Run
from sdm_deflect.meshing.mesh import TetMesh

Key = tuple[str, float, Strategy]


@dataclass(frozen=True, slots=True)
class Sources:
    """Meshes and runs of one scale.

    Attributes
    ----------
    folder : where runs write their files.
    """

    scale: str
    folder: Path
    display: Display
    cache: bool = True
    _runs: dict[Key, Run] = field(default_factory=dict)

    def case(self, name: str) -> Case:
        """Return a case at this scale."""
        return case_named(name, self.scale)

    def mesh(self, name: str) -> TetMesh:
        """Return the undeflected mesh of a case."""
        return meshed(self.case(name), Stopwatch(self.display), self.cache)[0]

    def run(self, name: str, angle: float, strategy: Strategy = "squv") -> Run:
        """Return a finished run with the paper's rule of adding centres, validated like every run."""
        key = (name, angle, strategy)
        if key not in self._runs:
            case = self.case(name)
            adaptation = replace(case.adaptation, rule="worst")
            case = replace(case, angle=angle, strategy=strategy, adaptation=adaptation)
            with TemporaryDirectory(dir=self.folder) as scratch:
                self._runs[key] = run_case(case, Stopwatch(self.display), Path(scratch), self.cache)
        return self._runs[key]


@contextmanager
def sources(scale: str, display: Display, cache: bool = True) -> Iterator[Sources]:
    """Yield the runs of a scale; their files vanish afterwards."""
    with TemporaryDirectory(prefix="sdm-study-") as folder:
        yield Sources(scale, Path(folder), display, cache)
