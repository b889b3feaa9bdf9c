"""The two sensors of the cost benchmarks, as studies without a plan: the article's, and one like a GelSight Mini."""

from __future__ import annotations

ARTICLE = {
    "study": "cost",
    "materials": {  # Sferrazza et al. 2019, table 1
        "ecoflex_gel": {"parameters": {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]}},
        "elastosil_25_1": {"parameters": {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]}},
    },
    "sensor": "config/sensors/paper.yaml",
    "indenter": {"kind": "sphere", "radius_mm": 5.0},
    "sessions": [],
}
GELSIGHT = {
    "study": "cost",
    "materials": {"gel": {"parameters": {"mu_kPa": [48.3333], "alpha": [2.0]}}},  # E = 0.145 MPa
    "sensor": {
        "width_x_mm": 20.75,
        "width_y_mm": 25.25,
        "layers": [{"name": "gel", "thickness_mm": 4.0, "material": "gel"}],
        "wall_mm": 0.0,
        "bins": {"nx": 13, "ny": 16},
    },
    "indenter": {"kind": "sphere", "radius_mm": 4.0},
    "mechanics": {"friction": 0.8},
    "sessions": [],
}
SENSORS = {"the article's": ARTICLE, "like a GelSight": GELSIGHT}
WIDTHS_MM = {"the article's": (32.0, 32.0), "like a GelSight": (20.75, 25.25)}
DEPTHS_MM = {  # eight, to a third and a quarter of the thickness
    "the article's": [0.25 * (k + 1) for k in range(8)],
    "like a GelSight": [0.125 * (k + 1) for k in range(8)],
}
