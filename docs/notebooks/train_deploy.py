# %% [markdown]
# # Train and deploy
#
# A network, its ONNX file, and forces of images without PyTorch. The recordings are SYNTHETIC, the mesh is coarse, 9 positions are pressed, training takes five steps.
# So **the forces mean nothing**; [The network](../learning.md) has the errors of a study.

# %%
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import gelforge as gf

gf.require("workflow", "learning", "export")
os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results
gf.run("gelforge examples", quiet=True)

# %% [markdown]
# ## Labels, features, network
#
# One target: Snakemake fits materials, solves three sites, draws two sessions, finds features, joins rows and trains.

# %%
gf.run("snakemake results/test/model/model.pt --cores 2 --quiet all --configfile config/test.yaml")

# %%
loss = pd.read_csv("results/test/model/loss.csv", usecols=["step", "training", "validation"])
print(loss.to_string(index=False))

# %% [markdown]
# ## Export
#
# The export compares its forces with PyTorch's and refuses a file that differs.

# %%
gf.run("gelforge export --model results/test/model/model.pt --out model.onnx")
print(f"model.onnx: {Path('model.onnx').stat().st_size / 1e6:.1f} MB")

# %% [markdown]
# ## Forces of images
#
# The source is a folder, a video or a camera's number; `--reference` is the image without contact.

# %%
session = Path("data/test/recordings/evening")
gf.run(
    f"gelforge predict {session}/images --model model.onnx --reference {session}/reference.png --out forces.csv"
)

# %%
forces = pd.read_csv("forces.csv")
print(*forces.columns[:8], "...", len(forces.columns), "columns")
plt.figure(figsize=(5.5, 3), layout="constrained")
plt.plot(-forces.fz_N, "o")
plt.xlabel("image")
plt.ylabel("-Fz, predicted [N]")

# %% [markdown]
# With a camera, `gelforge live 0 --model model.onnx --open` shows forces in the browser and sends them as JSON ([Forces in real time](../live.md)).
