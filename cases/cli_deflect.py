"""The command `sdm deflect`: turn a marked surface of any CFD mesh."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console

if TYPE_CHECKING:
    from sdm_deflect.cases.own.job import Job

FAILED = 1
FILE = click.Path(path_type=Path)
OF_SURFACE = ("hinge", "angle", "motion", "held", "driven", "strip", "table")
OF_JOB = ("fixed", "box", "margin", "zones", "strategy", "tolerance")


@click.command()
@click.argument("mesh", type=FILE)
@click.option("--surface", "surfaces", multiple=True, metavar="NAME", help="Patches that move; repeat, or use commas.")
@click.option("--hinge", nargs=2, metavar="x0,y0,z0 x1,y1,z1", help="Two points of the hinge line.")
@click.option("--angle", type=float, help="Degrees, right-handed from the first hinge point to the second.")
@click.option("--angles", metavar="A:B:STEP", help="Many angles, one file each; or a list with commas.")
@click.option("--motion", type=click.Choice(["rigid", "blended"]), help="Whole surface, or hinge to trailing edge.")
@click.option("--held", help="blended: nodes that stay: patches, or a .txt of node indices (default: --fixed).")
@click.option("--driven", help="blended: nodes that follow: edges[:DEG], patches, or a .txt (default: edges:40).")
@click.option("--strip", type=float, help="blended: width beside a closed rib, as a share of the span (0.2).")
@click.option("--table", help="Displacements instead of a hinge: .csv of x,y,z,dx,dy,dz, or .npz.")
@click.option("--fixed", multiple=True, metavar="NAME", help="Patches that stay; wildcards such as 'wing*'.")
@click.option("--slide", multiple=True, metavar="NAME:plane|cylinder", help="Patches that stay on their shape.")
@click.option("--zone", "zones", multiple=True, metavar="NAME", help="Further zones that deform; '*' for all.")
@click.option("--box", metavar="auto|FILE", help="The box: auto, or a .toml with `corners`.")
@click.option("--margin", type=float, help="Distance from the surface to an automatic box.")
@click.option("--steps", metavar="auto|N", default="auto", show_default=True, help="Most steps; auto: up to 8.")
@click.option("--strategy", type=click.Choice(["squv", "mv"]), help="Centres for each direction, or common ones.")
@click.option("--tolerance", type=float, help="Error at a data site (default: 1 % of the surface's median edge).")
@click.option("--allow-inverted", is_flag=True, help="Take a mesh that has inverted cells already.")
@click.option("--config", type=FILE, help="The same in a TOML file; several surfaces as [[surface]].")
@click.option("--out", type=FILE, help="File to write (default MESH-deflected); the suffix says the format.")
@click.option("--sensitivity", is_flag=True, help="Also write d(points)/d(angle), as .npz and .vtu.")
@click.option("--json", is_flag=True, help="Also write a report as JSON.")
@click.option("--dry-run", is_flag=True, help="Print what would be done, and write nothing.")
@click.option("--quiet", is_flag=True, help="No progress bars.")
@click.option("--verbose", is_flag=True, help="Progress as lines instead of bars: all that is reported.")
def deflect(mesh: Path, out: Path | None, dry_run: bool, quiet: bool, verbose: bool, **given: Any) -> int:
    """Deflect marked surfaces of a mesh file, and let the mesh around them follow.

    sdm deflect wing.su2 --surface flap --fixed wing --hinge 0.7,0,0 0.7,1,0 --angle 10 --motion blended
    """
    from sdm_deflect.cases.console import console
    from sdm_deflect.cases.own import carried_out, files, tables
    from sdm_deflect.cases.own.config import angles_from
    from sdm_deflect.cases.progress import Stopwatch, shown

    text = given.pop("angles")
    extras = frozenset(name for name in ("sensitivity", "json") if given.pop(name))
    many = angles_from(text) if text else ()
    inputs = _inputs(given)
    job = _job(given, max(many, key=abs) if many else None)
    wanted = files.Targets.of(mesh, out, many or (job.angle,), extras)
    wanted.check(inputs)

    def act(watch: Stopwatch) -> Any:
        if dry_run:
            return carried_out.dry_run(mesh, job, wanted.angles, watch)
        return carried_out.carry_out(wanted, job, watch)

    with shown(Console(stderr=True), quiet=quiet, verbose=verbose) as display:
        done = act(Stopwatch(display))
    if dry_run:
        names = [*map(wanted.mesh, wanted.angles), *wanted.extra]
        console().print(tables.plan_table(done), f"would write {', '.join(str(name) for name in names)}")
        return 0
    console().print(tables.result_table(done.plan, done.reports, done.files, done.lost))
    return 0 if done.passed else FAILED


def _inputs(given: dict[str, Any]) -> tuple[Path, ...]:
    """Return the files that options and the configuration file name."""
    from sdm_deflect.cases.own.config import read_config
    from sdm_deflect.cases.own.files import inputs_of

    config = given["config"]
    folder = config.parent if config else Path()
    named = inputs_of(read_config(config), folder) if config else ()
    return (*named, *inputs_of(given, folder), *inputs_of(given, Path()))


def _job(given: dict[str, Any], angle: float | None) -> "Job":
    """Return the job of a configuration file with the options of the command line in their place."""
    from sdm_deflect.cases.own.config import job_from, read_config

    config = given.pop("config")
    nested = read_config(config) if config else {}
    nested.update({key: given[key] for key in OF_JOB if given[key] not in (None, ())})
    if given["slide"]:
        nested["slide"] = {**nested.get("slide", {}), **dict(_slide(text) for text in given["slide"])}
    if given["steps"] != "auto":
        nested["max_steps"] = _steps(given["steps"])
    if given["allow_inverted"]:
        nested["allow_inverted"] = True
    own = {key: given[key] for key in OF_SURFACE if given[key] is not None}
    if angle is not None:
        own["angle"] = angle
    if given["surfaces"]:
        nested["surface"] = [{"patches": list(given["surfaces"]), **own}]
    elif own and nested.get("surface"):
        nested["surface"] = [{**nested["surface"][0], **own}, *_in_proportion(nested["surface"], angle)]
    return job_from(nested, config.parent if config else Path())


def _in_proportion(surfaces: list[dict[str, Any]], angle: float | None) -> list[dict[str, Any]]:
    """Return the further surfaces of a configuration, turned in their proportion to the first one's angle."""
    first = surfaces[0].get("angle")
    if angle is None or not first:
        return surfaces[1:]
    return [{**one, "angle": one["angle"] * angle / first} if "angle" in one else one for one in surfaces[1:]]


def _slide(text: str) -> tuple[str, str]:
    from sdm_deflect.cases.errors import InputError

    name, colon, shape = text.rpartition(":")
    if not colon or not name:
        raise InputError(f"--slide {text}: must be NAME:plane or NAME:cylinder")
    return name, shape


def _steps(text: str) -> int:
    from sdm_deflect.cases.errors import InputError

    if not text.isdigit() or int(text) < 1:
        raise InputError(f"--steps {text}: must be auto or a whole number from 1")
    return int(text)
