# %% [markdown]
# # Own sensor
#
# Fit a constitutive model to material tests, describe a sensor of two layers, draw it, press it, and compute derivatives.
# The tests are those of the demo and SYNTHETIC. Mesh and bootstrap are small, to be quick.

# %%
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt

import gelforge as gf

os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results


def show(picture, width=9):
    image = plt.imread(picture)
    plt.figure(figsize=(width, width * image.shape[0] / image.shape[1]), layout="constrained")
    plt.imshow(image)
    plt.axis("off")


# %% [markdown]
# ## Fit a constitutive model
#
# A folder of tests has one CSV per specimen and `samples.csv`. Files of other machines need a mapping (`config/mappings`). The better of two models is used.

# %%
gf.run("gelforge examples", quiet=True)  # the demo's tests
gf.run(
    "gelforge characterise data/demo/materials/elastosil_25_1 --laws ogden2,yeoh --bootstrap 20 --out skin"
)

# %%
show(next(Path("skin").rglob("*.png")))

# %% [markdown]
# ## The sensor
#
# Layers are named from the rigid base up. The skin takes the fitted model, the gel a known one.

# %%
Path("config/mine.yaml").write_text("""
study: mine
materials:
  gel: {parameters: {law: neo_hooke, mu_kPa: 15}}
  elastosil_25_1: {tests: data/demo/materials/elastosil_25_1, laws: [ogden2, yeoh]}
sensor:
  width_x_mm: 20
  width_y_mm: 16
  wall_mm: 0
  layers:
    - {name: gel, thickness_mm: 4, material: gel}
    - {name: skin, thickness_mm: 1, material: elastosil_25_1}
  bins: {nx: 10, ny: 8}
indenter: {kind: cylinder, radius_mm: 3, edge_radius_mm: 0.5}
plan:
  grid: {spacing_mm: 4.0, margin_mm: 5.0}
  depths_mm: [0.4, 0.8]
mechanics:
  mesh: {near_mm: 0.8, near_radius_mm: 4, far_mm: 2}
sessions: []
""")
gf.run("gelforge check mine")

# %%
show("results/mine/check.png")

# %% [markdown]
# ## One indentation
#
# An upright cylinder that then moves 0.3 mm along x, with friction. `--laws` names the fitted model.

# %%
gf.run(
    "gelforge press --study config/mine.yaml --laws skin/law.json --x 10 --y 8 --depths 0.4,0.8 --shear 0.3 0 --out press.h5"
)

# %% [markdown]
# ## Derivatives
#
# Derivatives of the force by each assumption cost about as much as a few more depths.

# %%
answer = gf.press(
    10.0,
    8.0,
    [0.4, 0.8],
    sensor={
        "width_x_mm": 20,
        "width_y_mm": 16,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 5, "material": "gel"}],
        "bins": {"nx": 10, "ny": 8},
    },
    materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 15}}},
    indenter={"kind": "sphere", "radius_mm": 4},
    mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 3, "far_mm": 2}},
    sensitivities=["gel_stiffness", "friction", "layer_thickness", "contact_zero"],
)
force = answer.total_force_N[-1, 2]
print(f"Fz at 0.8 mm: {force:.3f} N")
for name, slope in answer.slopes.items():
    print(f"{name}: {slope.total[-1, 2]:+.4f} N per {slope.unit}")
