"""SYNTHETIC sessions of a small sensor with an effect that the judge is not told, by the same solver on the same mesh.

Such recordings test that the stage does what it says; that it finds effects made by others is shown elsewhere
(validation).
"""

import numpy as np

from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.simulate import simulate_cell

HEADER = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
SITES = [(8.0, 8.0), (5.0, 8.0), (11.0, 8.0), (8.0, 5.0), (8.0, 11.0), (5.0, 5.0)]
DEPTHS = (0.4, 0.8, 1.2)
CONTACT_POINT_MM, ZERO_ROWS, DWELLS = 0.01, 4, 4


def record(
    folder, study, laws, change=lambda rows, force: force, seed=0, sites=SITES, order=None, noise_N=0.005
):
    """Write a session pressed on the study's sensor, every site to every depth in random order, and return its folder.

    change turns the forces (R, 3) as they are into those that are read, before noise; order: the presses' own.
    """
    rng = np.random.default_rng(seed)
    truth = {
        site: simulate_cell(study, laws, PlannedCell("t", *site, DEPTHS)).arrays["total_force_N"]
        for site in sites
    }
    presses = [(site, k) for site in sites for k in range(len(DEPTHS))]
    rows, force = [], []
    for number, i in enumerate(rng.permutation(len(presses)) if order is None else order):
        site, k = presses[i]
        depth, at = DEPTHS[k], 20.0 * number
        curve = np.vstack([np.zeros(3), truth[site]])
        slope = np.gradient(curve, np.array([0.0, *DEPTHS]), axis=0)[k + 1]
        held = truth[site][k] + rng.normal(0, CONTACT_POINT_MM) * slope
        course = [("zero", at + 0.1 * z, -1.0, np.zeros(3)) for z in range(ZERO_ROWS)]
        course += [("load", at + 4.0, depth, held)]
        course += [("dwell", at + 4.5 + 0.5 * d, depth, held) for d in range(DWELLS)]
        rows += [(f"p{number:03d}", number, time, phase, *site, d) for phase, time, d, _ in course]
        force += [c[3] for c in course]
    force = change(rows, np.array(force)) + rng.normal(0, noise_N, (len(force), 3))
    lines = [
        f"{p},,{order},{t:.3f},{phase},{x},{y},{d},1,,{f[0]:.5f},{f[1]:.5f},{f[2]:.5f},"
        for (p, order, t, phase, x, y, d), f in zip(rows, force)
    ]
    folder.mkdir(parents=True)
    (folder / "indentations.csv").write_text("\n".join([HEADER, *lines]) + "\n")
    (folder / "session.yaml").write_text(
        f"session: {folder.name}\nsynthetic: true\nbase_parameters: exact\n"
        f"force: {{acts_on: sensor, resolution_N: [0.001, 0.001, 0.001]}}\n"
        f"depth_zero: {{by: press, press_scatter_mm: {CONTACT_POINT_MM}}}\n"
    )
    return folder
