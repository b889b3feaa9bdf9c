"""Artificial presses: a Hertz-like force map and a smooth radial flow field, for tests of the learning stage.

Nothing here is mechanics; the numbers only have the size and the smoothness of a demo study: a ball of 5 mm pressed on a
32 x 32 mm sensor, 400 bins of 1.6 mm, 40 x 40 image regions, flow of up to some 10 px.
"""

from __future__ import annotations

import numpy as np

WIDTH, RADIUS, BINS, REGIONS, PX_PER_MM = 32.0, 5.0, 20, 40, 15.0
DEPTHS = np.arange(0.25, 2.01, 0.25)
FZ_CENTRE = np.array([0.0536, 0.1278, 0.2197, 0.3337, 0.4744, 0.6480, 0.8599, 1.1161])  # N, at DEPTHS


def grid_positions(n: int = 9, spacing: float = 2.75) -> np.ndarray:
    """Return the (n*n, 2) positions [mm] of a centred grid."""
    axis = WIDTH / 2 + spacing * (np.arange(n) - (n - 1) / 2)
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)


def force_map(x: float, y: float, depth: float) -> np.ndarray:
    """Return (400, 3) bin forces [N]: an elliptic pressure under the ball with normals along its surface."""
    fine = 8  # subdivisions of a bin along each side
    size = WIDTH / BINS / fine
    axis = (np.arange(BINS * fine) + 0.5) * size
    dx, dy = axis[None, :] - x, axis[:, None] - y
    a = 0.72 * np.sqrt(2 * RADIUS * depth)
    pressure = np.sqrt(np.maximum(0.0, 1 - (dx**2 + dy**2) / a**2))
    off_centre = np.hypot(x - WIDTH / 2, y - WIDTH / 2) / 15.6
    fz = np.interp(depth, DEPTHS, FZ_CENTRE) * (1 + 0.34 * off_centre**4)
    pressure *= fz / pressure.sum()
    lean = np.array([x - WIDTH / 2, y - WIDTH / 2]) / 11 * 0.1  # resultant sideways force near the edges
    f = np.stack(
        [pressure * (0.5 * dx / RADIUS + lean[0]), pressure * (0.5 * dy / RADIUS + lean[1]), -pressure],
        axis=-1,
    )
    f = f.reshape(BINS, fine, BINS, fine, 3).sum(axis=(1, 3)).reshape(BINS * BINS, 3)
    return np.where(np.abs(f) < 1e-9, 0.0, f)


def features(x: float, y: float, depth: float, rng: np.random.Generator, texture: np.ndarray) -> np.ndarray:
    """Return (3200,) features: mean magnitudes [px], then directions [rad], 0 where less than 0.05 px moved."""
    axis = (np.arange(REGIONS) + 0.5) * WIDTH / REGIONS
    dx, dy = axis[None, :] - x, axis[:, None] - y
    wall = (1 - np.exp(-(axis - 1) / 2)) * (1 - np.exp(-(WIDTH - 1 - axis) / 2))
    s = 2.2 + 0.5 * np.sqrt(max(depth, 0.0))
    bulge = (
        0.45
        * max(depth, 0.0)
        * PX_PER_MM
        * np.exp(-(dx**2 + dy**2) / (2 * s**2))
        * wall[None, :]
        * wall[:, None]
    )
    u = bulge * dx / s * texture[0] + rng.normal(0, 0.04, dx.shape)
    v = bulge * dy / s * texture[0] + texture[1] * bulge * 0.2 + rng.normal(0, 0.04, dx.shape)
    magnitude = np.hypot(u, v)
    direction = np.where(magnitude > 0.05, np.arctan2(v, u), 0.0)
    return np.concatenate([magnitude.ravel(), direction.ravel()]).astype(np.float32)


def presses(
    n: int = 9, spacing: float = 2.75, images: int = 5, seed: int = 0, depths=DEPTHS
) -> dict[str, np.ndarray]:
    """Return rows of a grid of presses: feature, label, cell, position, depth, press, image_index, untouched.

    The flow belongs to the depth with its scatter, the label to the commanded one; one untouched row per cell.
    """
    rng = np.random.default_rng(seed)
    texture = np.stack([rng.normal(1, 0.25, (REGIONS, REGIONS)), rng.normal(0, 1, (REGIONS, REGIONS))])
    rows = {k: [] for k in ("feature", "label", "cell", "position", "depth", "press", "image_index")}
    for c, (x, y) in enumerate(grid_positions(n, spacing)):
        for d, depth in enumerate([0.0, *depths]):
            label = force_map(x, y, depth) if depth > 0 else np.zeros((BINS * BINS, 3))
            true_depth = depth + rng.normal(0, 0.01) if depth > 0 else 0.0
            for i in range(images if depth > 0 else 1):
                rows["feature"].append(features(x, y, true_depth, rng, texture))
                rows["label"].append(label)
                rows["cell"].append(c)
                rows["position"].append((x, y))
                rows["depth"].append(depth)
                rows["press"].append(f"p{c:03d}_{d}")
                rows["image_index"].append(i)
    return {k: np.array(v) for k, v in rows.items()}
