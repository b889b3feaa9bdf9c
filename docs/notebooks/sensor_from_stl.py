# %% [markdown]
# # A sensor from STL
#
# A fingertip from a surface file, pressed by an indenter from another file, then moved sideways. Here a few lines write the files; yours come from a CAD program.
# A surface must be closed, in millimetres unless `mm_per_unit` is given.

# %%
import os
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import meshio
import numpy as np

import gelforge as gf

os.chdir(tempfile.mkdtemp())  # a folder of its own; take one of yours to keep the results

# %% [markdown]
# ## Two files
#
# The fingertip is a superellipse in plan, 18 x 14 mm, flat below, rounded above, 7 mm high. Its highest point is z = 0. The indenter is a wedge.


# %%
def revolve(rings, heights):
    """Return a closed surface through rings of points (K, N, 2) at heights (K,): a fan closes bottom and top."""
    count = rings.shape[1]
    points = [[*xy, z] for ring, z in zip(rings, heights) for xy in ring]
    points += [[0, 0, heights[0]], [0, 0, heights[-1]]]
    faces, low, high = [], len(points) - 2, len(points) - 1
    for k in range(count):
        j = (k + 1) % count
        faces += [[low, j, k], [high, (len(rings) - 1) * count + k, (len(rings) - 1) * count + j]]
        for row in range(len(rings) - 1):
            a, b = row * count + k, row * count + j
            faces += [[a, b, b + count], [a, b + count, a + count]]
    return meshio.Mesh(np.array(points, float), [("triangle", np.array(faces))])


angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
plan = (
    np.sign(np.stack([np.cos(angle), np.sin(angle)], 1))
    * abs(np.stack([np.cos(angle), np.sin(angle)], 1)) ** 0.7
)
rise = np.linspace(0, 0.49 * np.pi, 12)
rings = np.stack([plan * [9, 7] * np.cos(r) ** 0.8 for r in rise])
top = 5 * np.sin(rise) / np.sin(rise[-1])
rings, heights = np.concatenate([rings[:1], rings]), np.concatenate([[-7], top - 5])
meshio.write("fingertip.stl", revolve(rings, heights), binary=False)

gf.run("gelforge examples", quiet=True)  # brings config/indenters/wedge.stl
print(Path("config/indenters/wedge.yaml").read_text())

# %% [markdown]
# ## The study
#
# Solids from files are meshed with quadratic tetrahedra. `gelforge mesh` writes the mesh for ParaView and solves nothing.

# %%
Path("config/finger.yaml").write_text("""
study: finger
materials:
  silicone: {parameters: {law: neo_hooke, mu_kPa: 60}}
sensor:
  width_x_mm: 18
  width_y_mm: 14
  shape:
    kind: surfaces
    files: {body: fingertip.stl} # one for each layer
    origin_mm: [-9, -7, 0] # the corner of the rectangle around it, in the file's coordinates
  layers: [{name: body, thickness_mm: 7, material: silicone}]
  bins: {nx: 9, ny: 7}
indenter: config/indenters/wedge.yaml
plan:
  grid: {spacing_mm: 3, margin_mm: 6}
  depths_mm: [0.4, 0.8]
mechanics:
  mesh: {near_mm: 0.8, near_radius_mm: 3, growth: 0.4, far_mm: 1.8}
sessions: []
""")
gf.run("gelforge mesh --study config/finger.yaml --x 9 --y 7 --depth 0.8 --out finger.vtu")

# %% [markdown]
# ## Pressed and sheared

# %%
answer = gf.press(9.0, 7.0, [0.4, 0.8], study="config/finger.yaml", shear_mm=(0.2, 0.0))
for phase, depth, force in zip(answer.phase, answer.depth_mm, answer.total_force_N):
    print(f"{phase:>5} {depth:.1f} mm: Fx {force[0]:+.3f}  Fy {force[1]:+.3f}  Fz {force[2]:+.3f} N")

# %%
x, y = answer.node_xy_mm.T
down = np.linalg.norm(answer.node_normal_N[-1], axis=1)
fig, axes = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
for axis, values, title in (
    (axes[0], down, "normal force of each node [N]"),
    (axes[1], answer.node_friction_N[-1, :, 0], "friction along x of each node [N]"),
):
    dots = axis.scatter(x, y, c=values, s=12, cmap="viridis")
    axis.set(title=title, aspect="equal", xlabel="x [mm]")
    fig.colorbar(dots, ax=axis)

# %% [markdown]
# The standard deviation of the total shows the error of the coarse mesh.

# %%
print("error bar of the last state [N]:", answer.total_sigma_N[-1].round(3))
