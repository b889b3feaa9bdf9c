"""Write wedge.stl into this folder: a roof 8 mm long and 6 mm wide whose ridge (120 degrees) points down, ridge at z = 0."""

from pathlib import Path

import meshio
import numpy as np

LENGTH, WIDTH, HEIGHT = 8.0, 6.0, 6.0
SLOPE = np.tan(np.radians(30.0))

section = np.array(
    [
        [0, 0],
        [WIDTH / 2, SLOPE * WIDTH / 2],
        [WIDTH / 2, HEIGHT],
        [-WIDTH / 2, HEIGHT],
        [-WIDTH / 2, SLOPE * WIDTH / 2],
    ]
)
ends = [np.column_stack([np.full(5, x), section]) for x in (-LENGTH / 2, LENGTH / 2)]
fan = np.array([[0, i, i + 1] for i in (1, 2, 3)])
i, j = np.arange(5), (np.arange(5) + 1) % 5
sides = np.concatenate([np.stack([i, 5 + i, 5 + j], axis=-1), np.stack([i, 5 + j, j], axis=-1)])
triangles = np.concatenate([fan[:, ::-1], fan + 5, sides[:, ::-1]])
meshio.write(
    Path(__file__).with_name("wedge.stl"),
    meshio.Mesh(np.concatenate(ends), [("triangle", triangles)]),
    binary=False,
)
