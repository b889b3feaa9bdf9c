# %% [markdown]
# # Train and deploy
#
# The smallest study with images, from nothing to a network, its export to ONNX, and forces of images without PyTorch. Its recordings are SYNTHETIC
# (a virtual lab draws them), its mesh is coarse, 9 positions are pressed and training takes five steps: the steps are those of a real study, **the forces
# mean nothing**. What a real one reaches: [The network](../learning.md).

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
# One target: Snakemake runs what it needs. Materials are fitted, three sites solved, two sessions drawn, features found, rows joined, the network trained.

# %%
gf.run("snakemake results/test/model/model.pt --cores 2 --quiet all --configfile config/test.yaml")

# %%
loss = pd.read_csv("results/test/model/loss.csv")
print(loss.to_string(index=False))

# %% [markdown]
# ## Out
#
# The export compares its forces with PyTorch's and refuses a file that differs.

# %%
gf.run("gelforge export --model results/test/model/model.pt --out model.onnx")
print(f"model.onnx: {Path('model.onnx').stat().st_size / 1e6:.1f} MB")

# %% [markdown]
# ## Forces of images
#
# A folder, a video or a camera's number; `--reference` is the image without contact. ONNX Runtime computes, PyTorch is not needed.

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
# With a camera at hand, `gelforge live 0 --model model.onnx --open` shows the same in the browser and sends it to robots as JSON
# ([Forces in real time](../live.md)).
