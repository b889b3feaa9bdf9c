"""Write digit.stl next to this file: a DIGIT's gel drawn from the numbers below, which its gel's CAD file was measured for.

Source: facebookresearch/digit-design, commit de29222, DIGIT/gel, "Digit Gel.STEP". The frame is the sensor's: origin at a
corner of the rectangle around it, y towards the fingertip, z = 0 at the crown.
"""

from pathlib import Path

import meshio
import numpy as np

WIDTH, LENGTH, HEIGHT = 18.4, 25.0, 4.07  # over all
CORNER = 1.3  # radius of the two corners at the rear; the fingertip is a half circle
WALL = 1.3  # height of the side; 1.15 to 1.35 in the source
BEVEL = 1.3  # rise over run between the side and the crown
ACROSS = 21.4  # radius of the crown across
SAG, EXPONENT = 1.75, 3.2  # the crown's fall 12 mm from the middle along y, and its power
TIP, REAR = (
    1.0,
    2.6,
)  # powers p of the sum of both falls, (across^p + along^p)^(1/p): the rear corners stay high
RINGS = np.array([0.2, 0.4, 0.55, 0.7, 0.8, 0.88, 0.92, 0.96, 1.0])  # outlines shrunk towards the middle

half = WIDTH / 2
middle = np.array([half, LENGTH / 2])


def arc(x, y, radius, start, stop, count):
    """Return points (count, 2) of an arc about (x, y), angles in degrees from x."""
    t = np.radians(np.linspace(start, stop, count))
    return np.stack([x + radius * np.cos(t), y + radius * np.sin(t)], axis=-1)


def straight(a, b, count):
    """Return the points (count, 2) between a and b, the ends left out."""
    return a + np.linspace(0, 1, count + 2)[1:-1, None] * (np.asarray(b) - a)


def outline():
    """Return the edge of the gel (n, 2), counter-clockwise from above."""
    tip = arc(half, LENGTH - half, half, 0, 180, 31)
    rear = [arc(CORNER, CORNER, CORNER, 180, 270, 5), arc(WIDTH - CORNER, CORNER, CORNER, 270, 360, 5)]
    left, bottom, right = [tip[-1], rear[0][0]], [rear[0][-1], rear[1][0]], [rear[1][-1], tip[0]]
    return np.concatenate(
        [tip, straight(*left, 12), rear[0], straight(*bottom, 14), rear[1], straight(*right, 12)]
    )


def depth_inside(points, edge):
    """Return the distance of points (n, 2) from the polygon of the edge."""
    a, d = edge, np.roll(edge, -1, axis=0) - edge
    t = np.clip(np.einsum("nkj,kj->nk", points[:, None] - a, d) / (d**2).sum(axis=1), 0, 1)
    return np.linalg.norm(points[:, None] - a - t[..., None] * d, axis=-1).min(axis=1)


def top(points, edge):
    """Return the height over the base of points (n, 2): the crown, and the bevel near the edge."""
    x, y = (points - middle).T
    across, along = ACROSS - np.sqrt(ACROSS**2 - x**2), SAG * (np.abs(y) / 12) ** EXPONENT
    p = np.where(y > 0, TIP, REAR)
    crown = HEIGHT - (across**p + along**p) ** (1 / p)
    return np.minimum(crown, WALL + BEVEL * depth_inside(points, edge))


def surface():
    """Return vertices and triangles of the closed surface."""
    edge = outline()
    n = len(edge)
    plan = np.concatenate([middle + s * (edge - middle) for s in RINGS] + [middle[None]])
    upper = np.column_stack([plan, top(plan, edge) - HEIGHT])
    lower = np.column_stack([np.concatenate([edge, middle[None]]), np.full(n + 1, -HEIGHT)])
    i, j = np.arange(n), (np.arange(n) + 1) % n
    triangles = [np.stack([i, j, np.full(n, len(upper) - 1)], axis=-1)]
    rings = [(k * n, (k + 1) * n) for k in range(len(RINGS) - 1)]
    for inner, outer in [*rings, (rings[-1][1], len(upper))]:
        triangles += [
            np.stack([inner + i, outer + i, outer + j], axis=-1),
            np.stack([inner + i, outer + j, inner + j], axis=-1),
        ]
    triangles.append(np.stack([len(upper) + j, len(upper) + i, np.full(n, len(upper) + n)], axis=-1))
    return np.concatenate([upper, lower]), np.concatenate(triangles)


if __name__ == "__main__":
    vertices, triangles = surface()
    meshio.write(
        Path(__file__).with_name("digit.stl"), meshio.Mesh(vertices, [("triangle", triangles)]), binary=True
    )
