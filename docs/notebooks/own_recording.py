# %% [markdown]
# # Own recording
#
# Raw logs of a force sensor and a stage become a session. A few lines write the logs here (SYNTHETIC), with two clocks; with yours, begin at the mapping.
# A camera is one line more ([Raw logs to a session](../importing.md)).

# %%
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import gelforge as gf

os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results

# %% [markdown]
# ## Logs as a laboratory leaves them
#
# A stage presses eight times; its z falls, with contact at 31.37 mm. The force sensor has an offset, and its clock is 0.43 s late.

# %%
rng = np.random.default_rng(1)
TOUCH_MM, LAG_S = 31.37, 0.43
t, height, x = [0.0], [2.0], [8.0]


def go(seconds, to, at):
    t.append(t[-1] + seconds)
    height.append(to)
    x.append(at)


for press in range(8):
    at, depth = 7.0 + 0.5 * (press % 5), (0.4, 0.7, 1.0)[press % 3]
    go(1.0 + rng.uniform(), 2.0, at)  # rest above the surface
    go(0.4, 0.5, at)
    go(0.5 + depth, -depth, at)  # 1 mm/s
    go(1.2 + 0.4 * rng.uniform(), -depth, at)  # wait
    go(2.0 + depth, 2.0, at)
go(2.0, 2.0, x[-1])

stage_s = np.arange(0, t[-1], 1 / 31)
columns = {
    "X": np.interp(stage_s, t, x),
    "Y": np.full(len(stage_s), 8.0),
    "Z": TOUCH_MM + np.interp(stage_s, t, height),
}
columns = {
    name: (1000 * (mm + rng.normal(0, 5e-4, len(mm)))).round(1) for name, mm in columns.items()
}  # micrometres
pd.DataFrame({"t_ms": (1000 * stage_s).round(2)} | columns).to_csv("stage.csv", index=False)

force_s = np.arange(0, t[-1], 1 / 211)
push = 0.42 * np.maximum(-np.interp(force_s, t, height), 0) ** 1.6
forces = np.outer(push, [0.02, -0.01, -1.0]) + [0.31, -0.12, 1.7] + rng.normal(0, 0.003, (len(push), 3))
log = pd.DataFrame(forces.round(5), columns=["Fx", "Fy", "Fz"])
log.insert(0, "Time", (force_s + LAG_S).round(5))
log.to_csv("ft.csv", index=False)
print(log.head(3).to_string(index=False))

# %% [markdown]
# ## The mapping
#
# It says what the logs do not say. Errors name a missing key.

# %%
Path("logs.yaml").write_text("""\
describes: made logs, a ball under a stage
force: {file: ft.csv, time: {column: Time, unit: s}, columns: [Fx, Fy, Fz], unit: N}
stage:
  file: stage.csv
  time: {column: t_ms, unit: ms}
  x: X
  y: Y
  z: Z
  unit: um
  pressing: -z
depth_zero: session
session: {sensor: made, indenter: ball 4 mm, synthetic: true, force: {acts_on: sensor}}
""")
gf.run("gelforge import logs.yaml --out monday")

# %% [markdown]
# ## The page
#
# Check it: signals with the indentations marked, the lag, and force over depth about each contact point.

# %%
picture = plt.imread(next(Path(".").rglob("import.png")))
plt.figure(figsize=(9, 9 * picture.shape[0] / picture.shape[1]), layout="constrained")
plt.imshow(picture)
plt.axis("off")

# %% [markdown]
# ## Contact points and lag
#
# Contact points with intervals are on the stage's axis; `session.yaml` has the lag. True are 31.37 mm and 0.43 s.

# %%
found = pd.read_csv("monday/import.csv")
print(found.iloc[:, :8].to_string(index=False))

# %% [markdown]
# ## Next to a simulation
#
# Readings of the session and forces on a block of silicone, not fitted to each other.
# [What is missing in my simulation](missing_physics.md) explains such differences.

# %%
readings = pd.read_csv("monday/indentations.csv", comment="#")
zero = readings[readings.phase == "zero"].groupby("press")["fz_N"].mean()
held = readings[readings.phase == "dwell"]
answer = gf.press(
    8.0,
    8.0,
    [0.25, 0.5, 0.75, 1.0],
    sensor={
        "width_x_mm": 16,
        "width_y_mm": 16,
        "wall_mm": 0,
        "layers": [{"name": "gel", "thickness_mm": 4, "material": "gel"}],
        "bins": {"nx": 8, "ny": 8},
    },
    materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    indenter={"kind": "sphere", "radius_mm": 4},
    mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
)
plt.figure(figsize=(5, 3.2), layout="constrained")
plt.plot(held.depth_mm, -(held.fz_N - held.press.map(zero)), "o", label="readings (SYNTHETIC)")
plt.errorbar(
    answer.depth_mm, -answer.total_force_N[:, 2], answer.total_sigma_N[:, 2], fmt="-s", label="simulated"
)
plt.xlabel("depth [mm]")
plt.ylabel("-Fz [N]")
plt.legend()
