# %% [markdown]
# # Own sensor
#
# A constitutive model fitted to material tests, a sensor of two layers, a look at the geometry, one indentation, and what the force would do if the sensor were
# a little different. The tests here are those of the demo and SYNTHETIC; put yours in their place. Mesh and bootstrap are small, to be quick.

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
# A folder of tests has one CSV per specimen and `samples.csv`, which says what each one is. Files of other machines need a mapping
# (`config/mappings` has ten). Two constitutive models are fitted, the better one is used.

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
# Layers are named from the rigid base up. The skin takes the model that was just fitted, the gel one that is known.

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
# ## One indentation of it
#
# A cylinder, upright, that then moves 0.3 mm along x: friction appears. `--laws` names the constitutive model of the material that has tests.

# %%
gf.run(
    "gelforge press --study config/mine.yaml --laws skin/law.json --x 10 --y 8 --depths 0.4,0.8 --shear 0.3 0 --out press.h5"
)

# %% [markdown]
# ## What if it were different
#
# Derivatives say how the force follows each assumption; all of them cost about as much as a few more depths.

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
