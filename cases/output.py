"""The files of a run: written into a folder beside the target, then renamed into it, so each is whole."""

import csv
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from sdm_deflect.deform.volume.deflection import Deflection
from sdm_deflect.deform.volume.step import DIRECTIONS
from sdm_deflect.meshing.files import renamed
from sdm_deflect.meshing.formats.format import FULL


class OutputError(ValueError):
    """The output folder cannot be written."""


@contextmanager
def output_folder(target: Path) -> Iterator[Path]:
    """Yield a scratch folder in `target`; on success its files move into `target`, else nothing changes.

    Raises OutputError at once if the folder cannot be made or written, later if a file in it cannot, on a full disk for
    example; the message names the file that was to be.
    """
    new = not target.exists()
    try:
        target.mkdir(parents=True, exist_ok=True)
        scratch = TemporaryDirectory(prefix=".partial-", dir=target)
    except OSError as error:
        raise OutputError(f"--out {target}: {error.strerror}; choose a folder that can be written") from None
    try:
        with scratch as name, renamed(Path(name), target):
            yield Path(name)
            for path in sorted(p for p in Path(name).rglob("*") if p.is_file()):
                final = target / path.relative_to(name)
                final.parent.mkdir(parents=True, exist_ok=True)
                path.replace(final)
    except BaseException as error:
        if new and not any(target.iterdir()):
            target.rmdir()
        if isinstance(error, OSError) and error.errno in FULL:
            raise OutputError(f"{target}: cannot be written: {error.strerror}") from error
        raise


def write_interpolants(path: Path, deflections: Sequence[Deflection]) -> None:
    """Write centres and coefficients per direction, enough to evaluate the deformation elsewhere.

    The first surface's first step has the plain names `centers_x`, `beta_x`, `alpha_x`; further surfaces and
    steps append `_<surface>` and `_step<k>`. Those of the fit that carries sliding nodes, before these are put on
    their shapes, begin with `sliding_`. `hexahedron` (8, 3) says where each applies.
    """
    arrays: dict[str, np.ndarray] = {"kernel": np.array("thin_plate_spline")}
    for i, one in enumerate(deflections):
        tag = f"_{one.plan.surface}" if i else ""
        arrays[f"hexahedron{tag}"] = one.plan.region.hexahedron.corners
        for k, step in enumerate(one.steps):
            suffix = tag + (f"_step{k + 1}" if k else "")
            carrying = [("sliding_", fit) for fit in step.first.adaptations] if step.first else []
            for prefix, fit in (*carrying, *(("", fit) for fit in step.fits.adaptations)):
                for column, component in enumerate(fit.components):
                    name = f"{DIRECTIONS[component]}{suffix}"
                    arrays[f"{prefix}centers_{name}"] = fit.interpolant.centers
                    arrays[f"{prefix}beta_{name}"] = fit.interpolant.beta[:, column]
                    arrays[f"{prefix}alpha_{name}"] = fit.interpolant.alpha[:, column]
    np.savez_compressed(path, **arrays)  # type: ignore[arg-type]


def write_convergence(path: Path, deflections: Sequence[Deflection]) -> None:
    """Write the adaptation history: one row per surface, step, group and iteration."""
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["direction", "iteration", "centres", "max_error", "seconds", "surface", "step"])
        for one in deflections:
            for k, step in enumerate(one.steps, 1):
                for fit in step.fits.adaptations:
                    direction = "".join(DIRECTIONS[c] for c in fit.components)
                    for row in fit.history:
                        figures = (f"{row.max_residual:.6e}", f"{row.seconds:.6f}")
                        rows.writerow([direction, row.iteration, row.n_centers, *figures, one.plan.surface, k])
