"""The command lines whose results must not change when the structure of the code does."""

from collections.abc import Iterator
from dataclasses import dataclass

WALLS = ("--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane")
HINGE = ("--hinge", "0.7,0.3,0", "0.7,0.7,0")
BLENDED = (*WALLS, *HINGE, "--motion", "blended")
WRITTEN = ("su2", "cgns", "msh", "b8.ugrid", "grid", "vtu", "foam")
READ = (*WRITTEN, "lb4.ugrid", "ugrid", "cas.h5", "p3d")
CASES = ("aileron-free", "aileron", "aileron-chimera", "tail", "rudder", "all")


@dataclass(frozen=True)
class Command:
    """Words after ``sdm``, in a folder with the meshes of `tests.golden.inputs`."""

    words: tuple[str, ...]


def deflect(mesh: str, *words: str) -> Command:
    """Return a deflection without a report, which prints its figures."""
    return Command(("deflect", mesh, *words, "--no-report", "--json"))


def everything(real: bool) -> Iterator[tuple[str, Command]]:
    """Yield the commands by name; with `real` also those of the aircraft, whose meshes a cache must hold."""
    yield from formats()
    yield from conversions()
    yield from settings()
    yield from motions()
    yield from bound()
    yield from others()
    if real:
        for name in CASES:
            yield f"run {name}", Command(("run", name, "--no-report", "--out", "out"))
        yield "run aileron mv", Command(("run", "aileron", "--strategy", "mv", "--no-report", "--out", "out"))
        yield "run chimera -30", Command(("run", "aileron-chimera", "--angle", "-30", "--no-report", "--out", "out"))
        yield "run tail report", Command(("run", "tail", "--out", "out"))


def formats() -> Iterator[tuple[str, Command]]:
    """Yield a rewritten mesh of each format."""
    for suffix in READ:
        mesh = "wing" if suffix == "foam" else f"wing.{suffix}"
        words = ("--surface", "body", "--table", "table.csv") if suffix == "p3d" else (*BLENDED, "--angle", "12")
        yield f"rewrite {suffix}", deflect(mesh, *words)


def conversions() -> Iterator[tuple[str, Command]]:
    """Yield a mesh from SU2 in each format that is written."""
    for suffix in WRITTEN:
        out = "out" if suffix == "foam" else f"out.{suffix}"
        yield f"convert {suffix}", deflect("wing.su2", *BLENDED, "--angle", "-8", "--out", out)


def settings() -> Iterator[tuple[str, Command]]:
    """Yield each setting of accuracy, box, repair and output."""
    few = (*BLENDED, "--angle", "10")
    for words in (
        ("--strategy", "mv"), ("--tolerance", "1e-5"), ("--margin", "0.2"), ("--steps", "1"), ("--strip", "0.1"),
        ("--repair", "off"), ("--repair", "always"), ("--min-quality", "0.3"), ("--sensitivity", "--repair", "off"),
        ("--set", "kernel=mq", "--set", "kernel_radius=0.05"), ("--set", "kernel=wendland"), ("--set", "kernel=cubic"),
    ):  # fmt: skip
        yield f"deflect {' '.join(words)}", deflect("wing.su2", *few, *words)
    yield "deflect --angles", deflect("wing.cgns", *BLENDED, "--angles", "-10,0,10")
    yield "deflect large angle", deflect("wing.su2", *BLENDED, "--angle", "40")
    yield "deflect report", Command(("deflect", "wing.su2", *few))
    yield "deflect --select", deflect(
        "wing.su2", "--select", "rear=wing_upper box:0.6,-1,-1,2,2,1", "--surface", "flap_*", "--fixed", "wing_*,rear",
        *HINGE, "--angle", "5", "--motion", "blended", "--slide", "symmetry:plane",
    )  # fmt: skip


def motions() -> Iterator[tuple[str, Command]]:
    """Yield each law of motion, and several surfaces."""
    yield "rigid", deflect("body.su2", "--surface", "body", "--hinge", "1,1,0", "1,1,1", "--angle", "9")
    yield "table", deflect("body.su2", "--surface", "body", "--table", "table.csv")
    yield "plane mesh", deflect("flat.su2", "--surface", "body", "--hinge", "0.1,0.2", "--angle", "7")
    yield "settings in TOML", deflect("wing.su2", "--config", "job.toml")


def bound() -> Iterator[tuple[str, Command]]:
    """Yield what binds nodes to one another or needs several steps or boxes."""
    hinges = {
        "cyclic": ("0.7,0,0", "0.7,0.4,0"), "empty": ("0.7,0,0", "0.7,0.1,0"), "sector": ("0.5,0,1.1", "0.5,0,1.5"),
        "wedge": ("0.6,0.55,0", "0.6,0.55,0.1"),
    }  # fmt: skip
    fixed = {"sector": "blade,hub,casing", "wedge": "ring"}
    for name, hinge in hinges.items():
        words = ("--surface", "flap", "--fixed", fixed.get(name, "wing"), "--motion", "blended", "--hinge", *hinge)
        yield name, deflect(name, *words, "--angle", "12")
    yield "several steps", deflect("wing.su2", *BLENDED, "--angle", "75")
    yield (
        "plane mesh, repaired",
        deflect("flat.su2", "--surface", "body", "--hinge", "0.1,0.2", "--angle", "25", "--repair", "always"),
    )
    yield "three boxes", deflect("three.su2", "--config", "three.toml")


def others() -> Iterator[tuple[str, Command]]:
    """Yield commands that print, and those of the CAD."""
    for suffix in ("su2", "cgns", "msh", "vtu"):
        yield f"quality {suffix}", Command(("quality", f"wing.{suffix}", "--json"))
    yield "dry run", Command(("deflect", "wing.su2", *BLENDED, "--angle", "10", "--dry-run", "--json"))
    yield "list", Command(("list",))
    yield "no hinge", Command(("deflect", "wing.su2", *WALLS, "--angle", "10"))
    yield "wrong patch", Command(("deflect", "wing.su2", "--surface", "flaps", *HINGE, "--angle", "10"))
