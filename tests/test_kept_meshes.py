"""The kept meshes are those of today's geometry and mesher's settings, so that no test waits for the mesher."""

import json

import numpy as np
import pytest

from tests.kept_meshes import FOLDER, NAMES, digest


@pytest.mark.parametrize("name", NAMES)
def test_a_kept_mesh_has_the_parameters_of_its_case(name):
    with np.load(FOLDER / f"{name}.npz", allow_pickle=False) as kept:
        assert json.loads(str(kept["text"]))["digest"] == digest(name), "python -m tests.kept_meshes writes it again"
