"""Full disks: commands under limits of the size of files, and on a small file system in memory that has little room."""

import os
import resource
import subprocess
import sys
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path

import pytest

from sdm_deflect.base.files import NAME
from sdm_deflect.meshing.formats.registration import writable
from sdm_deflect.meshing.formats.registry import FORMATS
from tests.meshing.formats.wing import wing

pytestmark = pytest.mark.nightly
ROOT = Path(__file__).parents[2]
# Of what is written, or of its largest file, that the disk has room for.
SHARES = (0.0, 0.2, 0.6, 0.95)
TURN = (
    "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane", "--motion", "blended", "--hinge",
    "0.7,0.3,0", "0.7,0.7,0", "--angle", "8", "--quiet", "--repair", "off",
)  # fmt: skip
SUFFIXES = {name: FORMATS[name].suffixes[0] if name != "openfoam" else "" for name in writable()}
DEFLECT = ("deflect", "{home}/wing.su2", *TURN)
COMMANDS = {
    **{f"deflect {name}": ("deflect", f"{{home}}/wing{suffix}", *TURN, "--no-report", "--out", f"{{disk}}/out{suffix}")
       for name, suffix in SUFFIXES.items()},
    **{f"to {name}": (*DEFLECT, "--no-report", "--out", f"{{disk}}/out{suffix}")
       for name, suffix in SUFFIXES.items() if name not in ("su2", "openfoam")},
    "report": (*DEFLECT, "--report", "--sensitivity", "--out", "{disk}/out.su2"),
    "run": ("run", "tail", "--quiet", "--out", "{disk}/run"),
    **{f"export {name}": ("export", "{home}/run", "--quiet", "--format", name, "--out", f"{{disk}}/out{suffix}")
       for name, suffix in SUFFIXES.items()},
    **{form: ("geometry", "--quiet", "--out", f"{{disk}}/out.{form}") for form in ("step", "brep", "stl")},
}  # fmt: skip


def sdm(words, home, disk, limit=resource.RLIM_INFINITY):
    """Carry out a command whose files cannot be longer than `limit`; return its exit code and what it says."""
    allow = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    given = [sys.executable, "-m", "sdm_deflect", *(word.format(home=home, disk=disk) for word in words)]
    done = subprocess.run(given, stdout=-3, stderr=-1, text=True, cwd=ROOT, preexec_fn=allow, check=False)
    return done.returncode, done.stderr.strip()


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A wing in every format, and a run."""
    folder = tmp_path_factory.mktemp("home")
    for name, suffix in SUFFIXES.items():
        FORMATS[name].write(wing(cells=3).mesh, folder / f"wing{suffix}")
    assert sdm(COMMANDS["run"], folder, folder)[0] == 0
    return folder


def content(folder):
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != "ballast")
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


@contextmanager
def mounted(folder, size):
    """A file system in memory."""
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True, capture_output=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def fill(folder, room):
    """Fill a file system but for `room` bytes."""
    with (folder / "ballast").open("wb") as file:
        status = os.statvfs(folder)
        os.posix_fallocate(file.fileno(), 0, max(1, status.f_bavail * status.f_frsize - room))


@pytest.mark.parametrize("way", ["limited", "crowded"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_full_disk_keeps_the_old_files_and_is_one_line_that_names_the_target(name, way, home, tmp_path):
    words, disk, free = COMMANDS[name], tmp_path / "disk", tmp_path / "free"
    for folder in (disk, free):
        folder.mkdir()
    code, said = sdm(words, home, free)
    assert code == 0, said
    sizes = [*map(len, content(free).values())]
    total = max(sizes) if way == "limited" else sum(sizes)
    with mounted(disk, 4 * total + (8 << 20)) if way == "crowded" else nullcontext():
        if not (free / "out").is_dir():  # a case has to be new
            sdm(words, home, disk)
        before, kept = content(disk), 0
        for share in SHARES:
            room = int(share * total)
            if way == "crowded":
                fill(disk, room)
            code, said = sdm(words, home, disk, room if way == "limited" else resource.RLIM_INFINITY)
            if code == 0:  # blocks of the file system are not bytes
                assert share >= 0.9
                continue
            kept += 1
            assert (code, len(said.splitlines()), NAME in said) == (2, 1, False), said
            assert str(disk) in said
            assert content(disk) == before
        assert kept >= 3
