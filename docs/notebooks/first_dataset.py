# %% [markdown]
# # First dataset in ten minutes
#
# One indentation in Python, a small study whose labels the workflow solves, and its rows in PyTorch. Nothing is recorded or trained.
# The mesh is coarse, so that the page runs in about a minute; error bars are large.

# %%
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import gelforge as gf

gf.require("workflow", "learning")
os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results

# %% [markdown]
# ## One indentation
#
# A ball of 4 mm radius on a block of soft silicone. Forces act on the sensor: Fz is negative.

# %%
sensor = {
    "width_x_mm": 16,
    "width_y_mm": 16,
    "wall_mm": 0,
    "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
    "bins": {"nx": 8, "ny": 8},
}
answer = gf.press(
    8.0,
    8.0,
    [0.25, 0.5, 0.75, 1.0],
    sensor=sensor,
    materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    indenter={"kind": "sphere", "radius_mm": 4},
    mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
)
for depth, force, sigma in zip(answer.depth_mm, answer.total_force_N[:, 2], answer.total_sigma_N[:, 2]):
    print(f"{depth:.2f} mm: Fz = {force:.3f} N, error bar {sigma:.3f} N")

# %% [markdown]
# The label is the force on each bin of the surface; the bins add up to the total.

# %%
bins = answer.bin_force_N[-1].reshape(8, 8, 3)  # ny, nx, vector
fig, axes = plt.subplots(1, 3, figsize=(9, 2.8), layout="constrained")
for axis, component, name in zip(axes, np.moveaxis(bins, -1, 0), ("Fx", "Fy", "Fz")):
    limit = abs(component).max()
    image = axis.imshow(
        1000 * component,
        origin="lower",
        extent=(0, 16, 0, 16),
        cmap="RdBu",
        vmin=-1000 * limit,
        vmax=1000 * limit,
    )
    axis.set(title=name, xlabel="x [mm]")
    fig.colorbar(image, ax=axis, label="mN per bin")

# %% [markdown]
# ## A study
#
# The same sensor as a file, with a grid of positions. `gelforge init` writes the folder; a short study replaces its study.

# %%
gf.run("gelforge init mine", quiet=True)
Path("config/mine.yaml").write_text("""
study: mine
materials:
  gel: {parameters: {law: neo_hooke, mu_kPa: 20}}
sensor:
  width_x_mm: 16
  width_y_mm: 16
  wall_mm: 0
  layers: [{name: gel, thickness_mm: 4, material: gel}]
  bins: {nx: 8, ny: 8}
indenter: {kind: sphere, radius_mm: 4}
plan:
  grid: {spacing_mm: 3.0, margin_mm: 5.0} # 3 x 3 positions; symmetry leaves 3 to be solved
  depths_mm: [0.5, 1.0]
mechanics:
  mesh: {near_mm: 0.8, near_radius_mm: 2, far_mm: 2}
sessions: [] # labels only
""")
gf.run("gelforge check mine")

# %% [markdown]
# `labels` makes the dataset, without training.

# %%
gf.run("snakemake labels --cores 2 --quiet all --configfile config/mine.yaml")
print(*sorted(str(path) for path in Path("results/mine/dataset").iterdir()), sep="\n")

# %% [markdown]
# ## Its rows
#
# `gelforge.load_dataset` gives a split as a PyTorch dataset. Rows of test positions are never in `train`.

# %%
rows = gf.load_dataset("results/mine/dataset", "train")
print(len(rows), "rows; the first one:")
for name, value in rows[0].items():
    print(f"  {name}: {tuple(value.shape) if hasattr(value, 'shape') and value.ndim else value}")
