"""The commented files of a new study, for `gelforge init`."""

from __future__ import annotations

from pathlib import Path
from textwrap import indent

from gelforge.config import LAW_NAMES

CONFIG = """\
# Study {study}. Keys, units and limits: config/schema.json. Units: mm, N, kPa, s.
#   gelforge check {study}                                      validates and draws everything
#   snakemake --cores 2 --configfile config/{study}.yaml        makes results/{study}/
study: {study}
seed: 1

materials: # one entry for each material that the sensor's layers name
  gel:
    tests: data/{study}/materials/gel # raw tests, to be fitted
    laws: [ogden2] # more of {laws}: all fitted, the best one is used
  skin:
    parameters: # or a law that is known: W = sum mu/alpha (l1^alpha + l2^alpha + l3^alpha - 3)
      mu_kPa: [85.1168, -0.0020] # mu and alpha of one term have the same sign
      alpha: [2.8991, -8.2915]

sensor: data/{study}/sensor.yaml
indenter:
  kind: sphere
  radius_mm: 5.0

plan:
  file: data/{study}/plan.csv
  # or a regular grid, centred on the sensor:
  #   grid: {{spacing_mm: 2.75, margin_mm: 5.0}}
  #   depths_mm: [0.25, 0.5, 0.75, 1.0]
  # or what the recorded sessions pressed:
  #   from: sessions
  # symmetry: none   # solves every cell; auto, the default, makes mirrored and rotated ones from each other where that holds

sessions: [session1] # folders under data/{study}/recordings; []: labels only
mismatch:
  judged: true # a run judges which physics the simulation leaves out; false saves the minutes that gelforge check states

# variants: # cells solved again under other assumptions; the report draws them beside the study's own
#   wide_flange:
#     describes: with a flange
#     sensor: {{flange: {{width_mm: 2.0, height_mm: 1.0}}}}
#     cells: [centre] # of the plan; none: at the centre and 5 mm from two edges
"""

SENSOR = """\
# Frame: x and y along the edges, origin at a corner of the top surface, z up from the camera to the surface,
# 0 at the undeformed surface. A pressing ball gives negative Fz on the sensor.
width_x_mm: 32.0
width_y_mm: 32.0
layers: # from the rigid base up
  - name: gel
    thickness_mm: 4.5
    material: gel # a key of `materials`
    particle_volume_fraction: 0.02 # share of the gel's volume
  - name: skin
    thickness_mm: 1.5
    material: skin
wall_mm: 1.5 # thickness of the side wall (top layer's material) around the lower layers; 0: none
flange: null # or {width_mm: 2.0, height_mm: 1.0}, a rim on the base
bins: {nx: 20, ny: 20} # of the label, over the whole top surface
"""

PLAN = """\
# One row per position and depth: each cell has one position and all its depths.
cell,x_mm,y_mm,depth_mm
centre,16.0,16.0,0.5
centre,16.0,16.0,1.0
corner,25.0,25.0,0.5
corner,25.0,25.0,1.0
"""

SAMPLES = """\
# One row per sample; put each sample's file beside this one. Unknown values may stay empty.
# uniaxial, pure_shear: time_s,force_N,stretch_1[,stretch_2]
# equibiaxial:          time_s,pressure_kPa,apex_radius_mm,stretch_1[,stretch_2]
# or a ready-made curve: stretch_1,nominal_stress_kPa
file,test,sample,width_mm,gauge_length_mm,thickness_mm,strain_rate_per_s,age_days,temperature_C,cycle
uniaxial_01.csv,uniaxial,s01,10.0,40.0,0.5,0.003,,,
pure_shear_01.csv,pure_shear,s01,60.0,10.0,0.5,0.003,,,
equibiaxial_01.csv,equibiaxial,s01,,,0.5,0.003,,,
"""

CAMERA = """\
camera: # null for a force-only session
  width_px: 640
  height_px: 480
  focal_px: 430.0 # `gelforge calibrate-camera` finds it with the lens (distortion); or mm_per_px, where it is unknown
  centre_px: [319.5, 239.5]
  position_mm: [16.0, 16.0, -41.0] # the pinhole, in the sensor frame
  mirrored: true # true: u grows with x as seen from above
"""

SESSION = """\
# One recording session. Beside this file: indentations.csv, reference.png (the zero-force frame), images/.
# indentations.csv, one row per reading in the order taken; cell and image may be empty:
#   press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image
#   phase: zero, approach, load, dwell, unload or touch; five images of a press are five rows
session: session1
synthetic: false
sensor: "" # serial
indenter: {indenter}
date: 2024-05-14 # or "" where it is not known
notes: ""
force:
  acts_on: sensor # sensor: pressing reads negative Fz; indenter: the force sensor is above and reads the reaction
  axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] # rotation from the recorded axes to the sensor frame
  tared: false # false: each press's zero rows are subtracted
  resolution_N: [0.03, 0.03, 0.06]
  repeatability_N: null # standard deviation of a reading of x, y, z, e.g. [0.01, 0.01, 0.02], where few repeats show it
stage_to_sensor: # commanded position -> sensor frame
  origin_mm: [0.0, 0.0]
  rotation_deg: 0.0
  handedness: right
  repeatability_mm: null # standard deviation of the positions that the stage reaches; null: known to 0.01 mm
depth_zero: # null: not known
  by: session # or press: every press finds its own zero
  how: ""
  session_scatter_mm: null # standard deviation of the session's contact point, one error for all presses
  press_scatter_mm: null # that from press to press: the stage's repeatability; with by: press also each press's own zero
base_parameters: from_fit
{camera}crop_px: null # left, top, width, height
"""


LOGS = """\
# Raw logs of one session, named from this file's folder. Every key: docs/configuration.md; frames: docs/importing.md.
#   gelforge import data/{study}/logs.yaml --out data/{study}/recordings/monday --study {study}
describes: force sensor, robot and camera # in words
force:
  file: raw/ft.csv # or a ROS bag or MCAP file, with `topic`
  time: {{column: time, unit: s}} # or rate_hz: 1000
  columns: [Fx, Fy, Fz] # along the force sensor's x, y, z
  unit: N
stage:
  file: raw/stage.csv
  time: {{column: time, unit: s}}
  x: x
  y: y
  z: z
  unit: m # robots log metres, stages mm or um
  pressing: -z # along the column z deeper is down
camera: # how frames were taken; remove it for a force-only session
  video: raw/film.mp4 # or frames: a folder
  container: true # its own stamps; or times: a CSV of one stamp per frame
depth_zero: session # the median contact point; press: each indentation's own
session: # keys of session.yaml
  sensor: "" # serial
  indenter: {indenter}
  force:
    acts_on: indenter # of a force sensor on the robot, which reads the reaction; sensor: of one below the gel
    axes: [[1, 0, 0], [0, 1, 0], [0, 0, 1]] # force in the sensor frame = axes x recorded force
    resolution_N: [0.03, 0.03, 0.06]
  stage_to_sensor: # position in the sensor frame = R(rotation_deg) x position of the stage + origin_mm
    origin_mm: [0.0, 0.0]
    rotation_deg: 0.0
    handedness: right
    repeatability_mm: null # of the robot, standard deviation; null: found where positions are revisited
{camera}"""


def new_study_files(study: str) -> dict[Path, str]:
    """Return the files of a new study with their text, by path."""
    data = Path("data") / study
    return {
        Path("config") / f"{study}.yaml": CONFIG.format(study=study, laws=", ".join(LAW_NAMES)),
        data / "sensor.yaml": SENSOR,
        data / "plan.csv": PLAN,
        data / "materials" / "gel" / "samples.csv": SAMPLES,
        session_path(study): SESSION.format(indenter="ball of radius 5 mm", camera=CAMERA),
        logs_path(study): logs_text(study, "ball of radius 5 mm", CAMERA),
    }


def logs_text(study: str, indenter: str, camera: str) -> str:
    """Return the mapping of raw logs of a session; camera: its keys in session.yaml, as text."""
    return LOGS.format(study=study, indenter=indenter, camera=indent(camera, "  "))


def logs_path(study: str) -> Path:
    """Return where a new study's raw logs are described."""
    return Path("data") / study / "logs.yaml"


def session_path(study: str) -> Path:
    """Return where a new study's session is described."""
    return Path("data") / study / "recordings" / "session1" / "session.yaml"
