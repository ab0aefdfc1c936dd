"""Faults of one line, planted one after another in a copy: the tests of unit and contract fail.

python -m tests.faults [NUMBER ...]

plants all, or those of some numbers, and prints a table of what caught each; it ends with 1 if a fault was not caught,
or if its line is no longer there. The kinds are those that reviews found: a wrong sign, one off, a wrong limit, a
missing check, nodes in another order, a name that is lost, a file that is not brought to the disk.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
PRODUCT = ("sdm_deflect/base", "geometry", "meshing", "deform", "cases", "studies")
NOT_COPIED = shutil.ignore_patterns(".git", "_build", "__pycache__", ".*_cache", ".venv")


@dataclass(frozen=True, slots=True)
class Fault:
    """One line of the product, what is put in its place, and the tests that should fail then.

    Attributes
    ----------
    kind : of fault.
    old, new : text within one line of one file.
    tests : files or single tests, as pytest takes them.
    """

    kind: str
    old: str
    new: str
    tests: str

    def file(self, root: Path) -> Path:
        """Return the only file with the line; ValueError if there is none, or several."""
        files = [path for name in PRODUCT for path in (root / name).rglob("*.py") if self.old in path.read_text()]
        if len(files) != 1 or files[0].read_text().count(self.old) != 1:
            raise ValueError(f"{self.old!r} is in {len(files)} files; it must be in one, once")
        return files[0]


FAULTS = (
    Fault("a rotation of the other sign", "versine = 2.0 * np.sin(0.5 * angle) ** 2",
          "versine = -2.0 * np.sin(0.5 * angle) ** 2", "tests/deform/surface"),
    Fault("a section turns, and does not swing back", "0.5 * np.sinc(half) ** 2 * np.cross(turn, swing)",
          "0.0 * np.sinc(half) ** 2 * np.cross(turn, swing)", "tests/deform/surface/test_beams.py"),
    Fault("digits across a line are a slope", "vectors[rows], thin=THIN)", "vectors[rows])",
          "tests/deform/surface/test_tables.py"),
    Fault("a coefficient of a series", "0.6666666666655285", "0.6666666676655285", "tests/deform/rbf/test_kernels.py"),
    Fault("the adaptation ends too soon", "if last.max_residual < options.tol_stop:",
          "if last.max_residual < 10.0 * options.tol_stop:", "tests/deform/rbf/test_greedy.py"),
    Fault("the mean is not within what nodes may do", 'mean = np.einsum("gij,gj->gi", self.free, mean)',
          "mean = np.asarray(mean)", "tests/deform/volume/test_images.py"),
    Fault("layers may lie down", "share = now[2] / was[2]", "share = norm(now) / norm(was)",
          "tests/meshing/mesh/test_layers.py"),
    Fault("sliding nodes may leave their shape", "ON_SHAPE = 1e-9", "ON_SHAPE = 1e-3",
          "tests/deform/test_checks.py tests/deform/volume/test_sliding.py"),
    Fault("fixed nodes are not looked at", '_check_still("fixed_surfaces_moved", moved[fixed]',
          '_check_still("fixed_surfaces_moved", moved[fixed[:0]]', "tests/deform/test_checks.py"),
    Fault("cells that were inverted before count as well",
          "bad = inverted_of(deflection.points, block, rows, sign) & ~inverted_of(mesh.points, block, rows, sign)",
          "bad = inverted_of(deflection.points, block, rows, sign)", "tests/deform/test_inverted_before.py"),
    Fault("surfaces that crossed before are forgotten", "new = skin.new(now, skin.intersecting(mesh.points))",
          "new = now", "tests/meshing/mesh/test_crossing.py"),
    Fault("flat cells are not inverted", "quality[i], inverted[i] = share, least <= 0.0",
          "quality[i], inverted[i] = share, least < 0.0", "tests/meshing/mesh/test_quality.py"),
    Fault("a node is carried by another one", "offset[i] = places[q, i] - known[j, i]",
          "offset[i] = known[j, i] - places[q, i]", "tests/deform/around/test_near_wall.py"),
    Fault("nodes of a pyramid in another order", '"pyramid": (1, 0, 3, 4, 2)', '"pyramid": (0, 1, 3, 4, 2)',
          "tests/meshing/formats/test_ugrid.py"),
    Fault("node numbers from 0", "blocks[faces.shape].append(faces.nodes + 1)",
          "blocks[faces.shape].append(faces.nodes)", "tests/meshing/formats/test_ugrid.py"),
    Fault("a file of names loses its names", "return {int(row[0]): row[2] for row in rows if len(row) > 2}",
          "return {int(row[0]): row[2] for row in rows if len(row) > 3}", "tests/meshing/formats/test_ugrid.py"),
    Fault("a name is cut", "MARKER_TAG= {names[patch.name]}", "MARKER_TAG= {names[patch.name][:4]}",
          "tests/meshing/formats/test_su2.py"),
    Fault("the first face of a patch is one off", "startFace {patch.start};", "startFace {patch.start + 1};",
          "tests/meshing/formats/test_openfoam.py"),
    Fault("types of two shapes exchanged", '"wedge": 13, "pyramid": 14', '"wedge": 14, "pyramid": 13',
          "tests/meshing/test_vtu.py tests/meshing/formats/test_vtu.py"),
    Fault("prisms and pyramids exchanged", '"prisms": "wedge", "pyramids": "pyramid"',
          '"prisms": "pyramid", "pyramids": "wedge"', "tests/meshing/formats/test_tau.py"),
    Fault("a file is not brought to the disk", "os.fsync(handle)", "_ = handle", "tests/deform/test_files.py"),
    Fault("the mesh that is read may be written over",
          "source is not None and source.exists() and out.samefile(source) for", "source is not None and not out for",
          "tests/meshing/formats/test_every_format.py"),
    Fault("a copy may be nearly what was judged", "same = (points[:, :axes] == stored[:, :axes])",
          "same = np.isclose(points[:, :axes], stored[:, :axes])", "tests/cases/test_judged_as_written.py"),
    Fault("others may read a copy", "shared = path.stat().st_mode & 0o066", "shared = path.stat().st_mode | 0o066",
          "tests/deform/test_files.py tests/cases/test_strangers.py"),
    Fault("the key of a mesh forgets its parameters", '"parameters": dict(parameters)',
          '"parameters": sorted(parameters)', "tests/meshing/test_cache.py"),
    Fault("a formula in a table", 'FORMULA = ("=", "+",', 'FORMULA = ("+",', "tests/cases/test_output.py"),
    Fault("a failed verdict ends with 0", "return 0 if passed else FAILED", "return 0",
          "tests/cases/test_deflect_command.py tests/cases/sdm/test_metrics.py"),
    Fault("a moment of the other sign", "np.asarray(forces.moment @ np.array(hinge.axis))",
          "-np.asarray(forces.moment @ np.array(hinge.axis))", "studies/tests/flow"),
    Fault("lift along the wrong axis", "lift = np.array([-sin(a), 0.0, cos(a)])",
          "lift = np.array([sin(a), 0.0, cos(a)])", "studies/tests/flow"),
    Fault("a mode is left out", "out[rows] += value * vectors", "out[rows] += value * vectors * (amount > 0.0)",
          "tests/deform/test_mesh_motion.py"),
    Fault("a page may ask a network", "f\"default-src 'none'; {allowed}", "f\"default-src *; {allowed}",
          "tests/cases/test_report_page.py"),
    Fault("a rate of a track without its swing",
          "whole = turning + swing.turn @ turning + swing.rate @ (np.eye(3) + turn)",
          "whole = turning + swing.turn @ turning", "tests/deform/surface/test_tracks.py"),
    Fault("dependent functions of a track are kept", "strength > INDEPENDENT * strength[0]", "strength >= 0.0",
          "tests/deform/surface/test_tracks.py tests/cases/test_tracks.py"),
    Fault("an overlap of the other sign", "wrong = np.array([gap - now.gap, overlap - now.overlap])",
          "wrong = np.array([gap - now.gap, now.overlap - overlap])", "tests/deform/surface/test_slots.py"),
    Fault("an element is shifted away from the other", ".shift(gap, overlap) * (-1.0 if is_ahead else 1.0)",
          ".shift(gap, overlap)", "tests/deform/surface/test_slots.py"),
    Fault("a reflection keeps its hinge", "hinge=tuple((x, -y, z) for x, y, z in reversed(ends)),",
          "hinge=tuple((x, -y, z) for x, y, z in ends),",
          "tests/cases/test_job_settings.py"),
    Fault("down is up", "(surface.up if surface.down is None else -surface.down)",
          "(surface.up if surface.down is None else surface.down)", "tests/cases/test_job_settings.py"),
    Fault("columns of a table in the file's order", "return given[:, [columns[title] for title in wanted]]",
          "return given", "tests/cases/test_job_settings.py"),
    Fault("a plan moves beyond its range", "if not self.low <= amount <= self.high:", "if False:",
          "tests/cases/test_apply.py"),
    Fault("a rounded place is a place", "np.count_nonzero(distance <= NEAR * spacing)",
          "np.count_nonzero(distance < 0.0)", "tests/cases/test_apply.py tests/cases/test_plan_of_mesh.py"),
    Fault("a node in the box of no place", "if self.zones == 1 else 0", "if self.zones == 0 else 0",
          "tests/cases/test_plan_of_mesh.py"),
    Fault("a node's sensitivity counts twice", "if seen.max() > 1:", "if seen.max() > 2:",
          "tests/cases/test_gradient.py"),
    Fault("a number of a table is one off", "given[:, -1] if numbered else",
          "given[:, -1] - 1 if numbered else", "tests/cases/test_gradient.py"),
    Fault("a derivative of another amount", "out[rows] += speed * rate * vectors", "out[rows] += rate * vectors",
          "tests/deform/test_mesh_motion.py tests/cases/test_gradient.py"),
    Fault("sliding nodes leave their shape", "out[rows] = self._project(patch, rows, out[rows])", "pass",
          "tests/deform/volume/test_sliding.py tests/deform/volume/test_boundary.py"),
    Fault("two surfaces may tear a node apart", "if apart.any():", "if apart.all():",
          "tests/deform/volume/test_boundary.py tests/deform/volume/test_deflection.py"),
    Fault("a box that the motion leaves on its way", "shares = {k / POSES for k in range(1, POSES + 1)}",
          "shares = {1.0 / POSES}", "tests/deform/volume/test_region.py tests/deform/box/test_automatic.py"),
    Fault("boxes may overlap", "if depth > TOUCHING *", "if depth > 10.0 + TOUCHING *",
          "tests/deform/volume/test_deflection.py tests/cases/test_boxes.py"),
    Fault("zero sites beside the edges of a face", "~clearly_less(clear, CLEARANCE * spacing)", "clear >= 0.0",
          "tests/deform/box"),
    Fault("centres are added twice", "free[chosen] = False", "free[chosen[:0]] = False",
          "tests/deform/rbf/test_selection.py tests/deform/rbf/test_greedy.py"),
    Fault("a wrong guess is kept",
          "if not self.waiting or not np.array_equal(block, self.waiting[0][0].chosen[len(basis.chosen) :]):",
          "if not self.waiting:", "tests/deform/rbf/test_selection.py tests/deform/rbf/test_greedy.py"),
    Fault("a spline that is not rescaled", "Rescaling(self, length**2, length**2 * float(np.log(length)))",
          "Rescaling(self, length**2, length**2)", "tests/deform/rbf/test_kernels.py"),
    Fault("a repair moves nodes that are held", "return np.flatnonzero(near & movable)", "return np.flatnonzero(near)",
          "tests/meshing/repair"),
    Fault("a copy that stays behind", "hit = np.isfinite(gaps)", "hit = gaps < 0.0", "tests/cases/test_left_behind.py"),
    Fault("images may come apart", "limit = max(ON_IMAGE, WORSE * before, finest)", "limit = 1.0",
          "tests/deform/volume/test_images.py tests/deform/test_checks.py tests/meshing/mesh/test_pairing.py"),
    Fault("a limit is where cells fail", "low, high = (middle, high) if holds(at(middle)) else (low, middle)",
          "low, high = (middle, high)", "tests/cases/test_limit.py tests/cases/sdm/test_limit.py"),
    Fault("old polyhedra with sizes among their nodes",
          "return np.delete(stored, offsets[:-1]), offsets - np.arange(len(offsets))",
          "return np.delete(stored, offsets[:-1]), offsets", "tests/meshing/formats"),
    Fault("a rotation about another centre", "offset = centre - rotation @ centre + shift",
          "offset = centre + rotation @ centre + shift",
          "tests/meshing/formats/test_cgns_interfaces.py tests/meshing/formats/test_periodic.py"),
    Fault("normals point into the cells", "kept.rows(len(inner), len(rows)), plane) < 0.0:",
          "kept.rows(len(inner), len(rows)), plane) > 0.0:",
          "tests/meshing/formats/test_fluent.py tests/meshing/formats/test_plane_files.py"),
    Fault("the far side of a block", "first[axis] = last[axis] = size[axis] - 1 if far else 0",
          "first[axis] = last[axis] = size[axis] if far else 0", "tests/meshing/formats/test_plot3d_map.py"),
    Fault("blocks that do not touch are one", "if len(here) != len(there) or np.any(gap > NEAR *",
          "if len(here) != len(there) or np.any(gap > 1e9 *",
          "tests/meshing/formats/test_plot3d_map.py tests/meshing/formats/test_plot3d.py"),
    Fault("a fin that leans to the other side",
          "r * s + offset * c, -r * c + offset * s", "r * s + offset * c, -r * c - offset * s",
          "tests/geometry"),
    Fault("a wing without its gap", "section[[HINGE_UPPER, HINGE_LOWER], 0] -= notch",
          "section[[HINGE_UPPER, HINGE_LOWER], 0] -= 0.0", "tests/geometry"),
    Fault("half of the panel stays",
          "turned = vectors @ normal > cosine *", "turned = vectors @ normal > 0.999999 *",
          "tests/deform/surface/test_tail_root.py"),
    Fault("a table of motion without its kinks", "amounts = np.unique(np.concatenate([*rows, before]))",
          "amounts = np.unique(np.concatenate(rows))", "tests/deform/test_motion_fields.py"),
    Fault("a field in a part of its nodes", "whole[rows] = field", "whole[: len(field)] = field",
          "tests/deform/test_motion_fields.py"),
)  # fmt: skip


def caught(fault: Fault, root: Path) -> str:
    """Plant a fault in a copy of the program; return a test that fails then and not before, nothing if none does."""
    path = fault.file(root)
    before = path.read_text()
    path.write_text(before.replace(fault.old, fault.new))
    try:
        failing = failed(fault.tests.split(), root)
    finally:
        path.write_text(before)
    anyway = failed(failing, root) if failing else []
    return next((test for test in failing if test not in anyway), "")


def failed(tests: Sequence[str], root: Path) -> list[str]:
    """Return the first tests that fail in a copy of the program."""
    words = ["-m", "pytest", "--maxfail=3", "-q", "-n", "0", "-p", "no:cacheprovider", "--no-header", *tests]
    environment = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run([sys.executable, *words], cwd=root, env=environment, capture_output=True, text=True)
    lines = (line.partition(" - ")[0].partition(" ") for line in done.stdout.splitlines())
    return [test for word, _, test in lines if word in ("FAILED", "ERROR") and "::" in test]


def main(numbers: Sequence[int]) -> int:
    """Plant faults, print what caught each, and return the exit code."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # else a run in the background hands on that it is ignored
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        root = Path(shutil.copytree(ROOT, Path(folder) / "program", symlinks=True, ignore=NOT_COPIED))
        for number in numbers or range(1, len(FAULTS) + 1):
            fault = FAULTS[number - 1]
            test = caught(fault, root)
            missed += not test
            sys.stdout.write(f"| {number} | {fault.kind} | {test or '**nothing**'} |\n")
            sys.stdout.flush()
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main([int(word) for word in sys.argv[1:]]))
