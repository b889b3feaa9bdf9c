"""Meshes of the small shapes, made once."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_shapes import SHAPES, SIZES

from gelforge.meshing.tetrahedra import tetrahedral_mesh


@pytest.fixture(scope="session", params=SHAPES, ids=SHAPES)
def meshed(request):
    solids, touched = SHAPES[request.param]
    touched = np.array([touched])
    mesh = tetrahedral_mesh(solids, SIZES, touched)
    return SimpleNamespace(name=request.param, solids=solids, touched=touched, mesh=mesh)
