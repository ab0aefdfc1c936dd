"""A setting and a check are added in one file each: what a command does with a line more in it.

A motion, a kernel and a mesh format are those of the guide's examples: one file each (docs/tests, test_own_format).
"""

import json
import subprocess
import sys

import pytest

from sdm_deflect.meshing.formats.registry import FORMATS

# Carries out a command with another text in place of a line of one module.
CHANGED = """
import sys
from importlib import import_module, util
name, old, new = sys.argv[1:4]
spec = util.find_spec(name)
text = open(spec.origin, encoding="utf-8").read()
assert text.count(old) == 1, text.count(old)
module = util.module_from_spec(spec)
sys.modules[name] = module
exec(compile(text.replace(old, new), spec.origin, "exec"), module.__dict__)
setattr(import_module(spec.parent), name.rpartition(".")[2], module)
sys.argv[1:] = sys.argv[4:]
import_module("sdm_deflect.cases.cli").main()
"""


@pytest.fixture(scope="module")
def deflected(hybrid_wing, tmp_path_factory):
    """Deflect a wing with one module changed; return the exit code, the standard output and the errors."""
    folder = tmp_path_factory.mktemp("additions")
    FORMATS["su2"].write(hybrid_wing.mesh, folder / "wing.su2")

    def run(module, old, new, *more):
        words = (
            "deflect", "wing.su2", "--surface", "flap_*", "--fixed", "wing_*", "--slide", "symmetry:plane",
            "--motion", "blended", "--hinge", "0.7,0.3,0", "0.7,0.7,0", "--angle", "2",
            "--repair", "off", "--no-report", *more,
        )  # fmt: skip
        command = [sys.executable, "-c", CHANGED, module, old, new, *words]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout, done.stderr

    return run


def test_a_check_is_added_in_one_file(deflected):
    line = "    yield surfaces_crossed(mesh, points)\n"
    more = line + '    yield Check("farthest_node", float(moved.max()), 1e-3, "", "all nodes", over=len(moved))\n'
    code, out, errors = deflected("sdm_deflect.deform.checks", line, more, "--out", "checked.su2", "--json")
    assert errors == ""
    checks = {check["name"]: check for check in json.loads(out)["angles"][0]["validation"]["checks"]}
    assert checks["farthest_node"]["value"] > 1e-3
    assert (code, checks["farthest_node"]["verdict"]) == (1, "FAILED")  # it decides on the run as others do


@pytest.mark.parametrize(
    ("given", "code", "said"), [("0.5", 0, ""), ("-1", 2, "patience = -1 must be a number of at least 0")]
)
def test_a_setting_is_added_in_one_file(deflected, given, code, said):
    line = "    # fmt: on\n\n    def __post_init__(self) -> None:\n        check_settings(self)\n        if self.max"
    field = '    patience: Annotated[float, Range(0.0), Doc("Accuracy", "Hours.")] = 1.0\n'
    module, option = "sdm_deflect.deform.rbf.fitting", ("--patience", given)
    done = deflected(module, line, field + line, *option, "--dry-run")
    assert done[0] == code, done
    assert said in done[2]
