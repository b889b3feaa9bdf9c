"""Closed surfaces of triangles for the tests: a block, an L, a ball and a cylinder, vertices [mm] and triangles outward."""

import numpy as np

CUBE = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], float
)


def prism(polygon, low, high):
    """Return the upright prism over a polygon (n, 2), counter-clockwise, whose triangles fan out from its first corner."""
    n = len(polygon)
    vertices = np.concatenate([np.column_stack([polygon, np.full(n, z)]) for z in (low, high)])
    fan = np.array([[0, i, i + 1] for i in range(1, n - 1)])
    i = np.arange(n)
    j = (i + 1) % n
    sides = np.concatenate([np.stack([i, j, n + j], -1), np.stack([i, n + j, n + i], -1)])
    return vertices, np.concatenate([fan[:, ::-1], fan + n, sides])


def block(x, y, z):
    """Return the block of these sizes on its lower face, like mechanics.indenters.shapes.Box."""
    return prism(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]) / 2, 0.0, z)


def l_shape():
    """Return an L with one concave edge; all fans of triangles start at the inner corner, so that none leaves the body."""
    return prism(np.array([[0, 0], [0, 3], [-2, 3], [-2, -2], [3, -2], [3, 0]], float), 0.0, 4.0)


def ball(radius, rings=24):
    """Return a ball of triangles whose corners lie on the sphere about the origin."""
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(2 * rings) / (2 * rings)
    a, b = np.meshgrid(polar, around, indexing="ij")
    middle = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), -np.cos(a)], -1).reshape(-1, 3)
    vertices = radius * np.concatenate([[[0, 0, -1.0]], middle, [[0, 0, 1.0]]])
    n, top = len(around), len(vertices) - 1
    i = np.arange(n)
    j = (i + 1) % n
    parts = [np.stack([np.zeros(n, int), 1 + j, 1 + i], -1)]
    for ring in range(rings - 2):
        low, high = 1 + ring * n, 1 + (ring + 1) * n
        parts += [np.stack([low + i, low + j, high + j], -1), np.stack([low + i, high + j, high + i], -1)]
    last = 1 + (rings - 2) * n
    parts.append(np.stack([last + i, last + j, np.full(n, top)], -1))
    return vertices, np.concatenate(parts)


def cone(radius, height, sides=24):
    """Return a cone whose sharp tip lies at the origin and whose flat end lies at this height."""
    around = 2 * np.pi * np.arange(sides) / sides
    rim = np.column_stack([radius * np.cos(around), radius * np.sin(around), np.full(sides, height)])
    vertices = np.concatenate([[[0, 0, 0.0]], rim, [[0, 0, height]]])
    i = 1 + np.arange(sides)
    j = 1 + (np.arange(sides) + 1) % sides
    tip, middle = np.zeros(sides, int), np.full(sides, sides + 1)
    return vertices, np.concatenate([np.stack([tip, j, i], -1), np.stack([i, j, middle], -1)])
