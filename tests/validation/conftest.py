"""A library of made-up coefficients: the drawing, sealing and scoring need no solution of FElupe."""

import numpy as np
import pytest


def change(scale: float):
    from validation.library import Change

    log_ratio, horizontal = np.zeros((4, 3)), np.zeros((4, 3))
    log_ratio[0, :2] = scale, 0.1 * scale
    log_ratio[1, 0] = -0.004 * scale
    horizontal[0, 0] = 1e-3 * scale
    return Change(log_ratio, horizontal)


@pytest.fixture(scope="session")
def library():
    pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
    from validation import solves
    from validation.library import Library, LocalChange
    from validation.sensors import SENSORS, SMALL
    from validation.surface import Surface

    shape = np.log([0.2, 0.8, 1.85]), np.log([0.03, 0.2, 1.0])
    nodes, depths = np.array(SMALL.nodes), np.exp(shape[0])
    ratio = 1 + 0.003 * (nodes[:, None, None] ** 2 + nodes[None, :, None] ** 2) + 0.01 * depths
    flat = np.broadcast_to(-4e-3 * nodes[:, None, None], ratio.shape)
    vertical = Surface.through(nodes, depths, ratio, 1)
    horizontal = Surface.through(nodes, depths, flat, 1, sign=-1)
    sizes = {"gel softer": -0.15, "gel stiffer": 0.15, "thicker": -0.06, "thinner": 0.07}
    changes = {name: change(sizes.get(name, 0.05)) for sensor in SENSORS.values() for name in sensor.effects}
    defects = {
        (name, place): LocalChange(
            np.array(touched), np.full((len(touched), 3), -0.03), np.full((len(touched), 3, 2), 1e-3)
        )
        for name in solves.DEFECTS
        for place, (_, touched) in solves.DEFECT_PLACES.items()
    }
    return Library(shape, vertical, horizontal, np.array([7.0, 5.0, 0.0, 0.0]), changes, defects)
