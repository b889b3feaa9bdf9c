# %% [markdown]
# # What is missing in my simulation
#
# Does a recording differ from the simulation by more than the known errors, and why? This recording is SYNTHETIC.
# The frame of the stage yields by 0.06 mm per newton, which the study does not state. To be quick, only seven effects are weighed.

# %%
import json
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import gelforge as gf

os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results

# %% [markdown]
# ## The study
#
# The mesh is coarse, so that the page runs in a minute. The recording is made on the same mesh: `discretisation` states a small error.
# Changes by effects need elements below a quarter of the ball's radius: `coarser: 1.2` solves them on elements of 0.96 mm.

# %%
TRIED = (
    "contact_zero force_gain frame_compliance friction gel_stiffness indenter_radius layer_thickness".split()
)
ALL = """adhesion ageing base_bending body_stiffness clock_offset compressibility contact_zero cross_talk delamination
elastic_base force_drift force_frame force_gain force_hysteresis force_offset force_unit frame_compliance friction
friction_law frictionless gel_stiffness grid_scale inclusion indenter_radius lateral_play law_exponent layer_thickness
linear_elasticity misregistration mullins particle_settling prestretch small_strain temperature thickness_gradient tilt
toe_region viscoelastic void wall_gap wall_stiffness yaw""".split()
Path("study.yaml").write_text(f"""
study: mine
materials:
  gel: {{parameters: {{law: neo_hooke, mu_kPa: 30}}}}
sensor:
  width_x_mm: 16
  width_y_mm: 16
  wall_mm: 0
  layers: [{{name: gel, thickness_mm: 4, material: gel}}]
  bins: {{nx: 8, ny: 8}}
indenter: {{kind: sphere, radius_mm: 4}}
plan:
  grid: {{spacing_mm: 3.0, margin_mm: 5.0}}
  depths_mm: [0.3, 0.6, 0.9, 1.2]
mechanics:
  mesh: {{near_mm: 0.8, near_radius_mm: 2, far_mm: 2}}
sessions: []
mismatch:
  coarser: 1.2
  discretisation: 0.002
  leave_out: [{", ".join(sorted(set(ALL) - set(TRIED)))}]
""")

# %% [markdown]
# ## The recording
#
# Nine positions in random order. The indenter goes 0.06 mm less deep for each newton. The force has noise, the sensor's zero an offset.

# %%
rng = np.random.default_rng(3)
COMPLIANCE = 0.06  # mm per N: what the study leaves out
DEPTHS = np.array([0.3, 0.6, 0.9, 1.2])
rows, clock = [], 0.0
places = [(x, y) for x in (5.0, 8.0, 11.0) for y in (5.0, 8.0, 11.0)]
for order, k in enumerate(rng.permutation(9)):
    x, y = places[k]
    reached = DEPTHS
    for _ in range(3):
        solved = gf.press(x, y, reached, study="study.yaml", mechanics={"error_bars": False})
        reached = DEPTHS - COMPLIANCE * abs(solved.total_force_N[:, 2])
    for _ in range(3):
        rows.append(("zero", -1.0, np.zeros(3)))
    for depth, force in zip(DEPTHS, solved.total_force_N):
        rows += [("load", depth, force), ("dwell", depth, force), ("dwell", depth, force)]
    for i, (phase, depth, force) in enumerate(rows[-15:]):
        clock += 1.0
        seen = force + [0.2, -0.1, 0.5] + rng.normal(0, 0.002, 3)
        rows[len(rows) - 15 + i] = (
            f"p{order}",
            "",
            order,
            clock,
            phase,
            x,
            y,
            depth,
            1.0,
            "",
            *seen.round(5),
            "",
        )
header = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image".split(
    ","
)
Path("session").mkdir()
pd.DataFrame(rows, columns=header).to_csv("session/indentations.csv", index=False)
Path("session/session.yaml").write_text("""\
session: session
synthetic: true
force: {acts_on: sensor, tared: false, resolution_N: [0.001, 0.001, 0.001]}
depth_zero: {by: session, session_scatter_mm: 0.01, press_scatter_mm: 0.003}
base_parameters: exact
""")

# %% [markdown]
# ## The verdict

# %%
gf.run("gelforge mismatch session --config study.yaml --out out")

# %%
verdict = json.loads(Path("out/verdict.json").read_text())
print("state:", verdict["state"])
for answer in verdict["answer"]:
    print("shares:", {effect: round(share, 2) for effect, share in answer["shares"].items()})
print("next:", verdict["next_experiments"][0]["words"])
print(Path("out/config.patch.yaml").read_text())

# %% [markdown]
# The true effect, the compliance of the frame, leads a credible set, and its 90 % interval holds the true 0.06 mm per newton.
# These nine positions cannot exclude the others, and the verdict says what would. `gelforge mismatch plan` lists such experiments with their minutes.
# The patch puts the leading effect into the study. `out/report.html` has the whole page.

# %%
readings = pd.read_csv("out/readings.csv").query("axis == 'z'")
fig, axis = plt.subplots(figsize=(5.5, 3.2), layout="constrained")
for column, words in (("base_N", "study"), ("after_N", "with the answer")):
    off = -1000 * (readings.measured_N - readings[column])
    axis.errorbar(readings.depth_mm, off, 1000 * readings.sigma_N, fmt="o", ms=3, label=f"read - {words}")
axis.axhline(0, color="k", lw=0.5)
axis.set(xlabel="depth [mm]", ylabel="-Fz [mN]")
axis.legend()
