"""The table of the commands that people call: function, what it does, arguments; standard library only.

The order is that of `gelforge --help`. `export dataset` is a command of `export`. What the workflow runs is in
workflow_commands.py.
"""

from __future__ import annotations

from argparse import SUPPRESS
from functools import partial
from pathlib import Path

from gelforge.cli.shared_arguments import FOLDER, OneOf, arg, command, flag, laws, need, study, written
from gelforge.cli.values import board_size, depth_list
from gelforge.dataset.exports import NAMES as FORMATS
from gelforge.importing.public import NAMES as LAYOUTS

MATCHED = partial(study, "--study --config", dest="config", required=True)
SETTINGS = study(text="whose sensor and settings are used; the article's if not given")
LAWS = laws(nargs="*", default=[])
PLACE = (
    need("--x", "position along x [mm], origin at the corner", float),
    need("--y", "position along y [mm]", float),
)
INDENTER = arg("--indenter", "any indenter, see config/indenters; else the study's", Path, metavar="YAML")
TESTS = (
    arg("sources", "folders with samples.csv or small tests, or files", Path, nargs="+"),
    arg("--mapping", "YAML that describes the files, see config/mappings", Path),
)
NEW = written("new folder", metavar="FOLDER")
KEPT = (
    arg("--kept", "folder of kept solutions; solves in --out if not given", Path),
    arg("--workers", "indentations that are solved side by side", int, default=1),
)
NO_PAGE = partial(arg, "--no-page", dest="page", action="store_false")
PLANE = "mean height of the particles"
FRAMES = (
    arg("source", "folder of images, video file, or camera number"),
    need("--model", "model.onnx, or model.pt of a study", Path),
    arg("--reference", "zero-force image; the source's first frame if not given", Path),
    arg("--crop", "part of each image to use [px]", int, nargs=4, metavar=("LEFT", "TOP", "WIDTH", "HEIGHT")),
    arg(
        "--camera",
        "calibration and pose of the camera (or a session.yaml): frames are remapped to the model's view",
        Path,
        metavar="YAML",
    ),
    arg("--plane-z-mm", f"{PLANE}, for a model whose sessions had no `remap` [mm, sensor frame]", float),
)

COMMANDS = {
    # --- a study
    "init": command(
        "study.init.init",
        "write a commented configuration and sample tables for a new study",
        arg("study", "name of the new study"),
        arg("--sensor", "of this sensor, ready to run; `gelforge sensors` lists them", metavar="NAME"),
    ),
    "examples": command(
        "study.init.examples",
        "write the example studies, the demo among them, and their data into this folder",
    ),
    "sensors": command(
        "study.shipped_sensors.sensors",
        "list the sensors that are shipped, or draw one cut through its middle",
        arg("name", "a shipped sensor, or a study's YAML file", nargs="?"),
        arg("--out", "PNG to write; NAME.png if not given", Path),
    ),
    "check": command(
        "study.check.check",
        "check a study and its data, all errors at once; draw it; print cells, minutes and disk",
        study("study"),
        arg("--picture", "PNG to write; results/<study>/check.png if not given", Path),
    ),
    "show": command(
        "study.show.show",
        "draw a label: a cell's or a shard's force distribution",
        arg("path", "an HDF5 file", Path, metavar="CELL_OR_SHARD"),
        arg("row", "depth step of a cell or row of a shard; the last if not given", int, nargs="?"),
        arg("--out", "PNG to write; named after the file, in the working directory, if not given", Path),
    ),
    "explain": command(
        "study.show.explain",
        "say where one row of a shard comes from, down to raw files",
        arg("path", "a shard", Path, metavar="SHARD"),
        arg("row", "row of the shard", int),
    ),
    "unlock": command(
        "study.unlock.unlock", "after a run that was killed: end what it left computing and release its lock"
    ),
    # --- by hand
    "press": command(
        "by_hand.press.press",
        "press once on a sensor and print the force-depth table",
        *PLACE,
        need("--depths", "depths [mm]: first:last:step, or a comma-separated list", depth_list),
        INDENTER,
        arg(
            "--shear", "then move sideways by this [mm] at the last depth", float, nargs=2, metavar=("X", "Y")
        ),
        arg(
            "--twist",
            "then turn the indenter about z by this [deg]; the table shows the torque",
            float,
            default=0.0,
            metavar="DEG",
        ),
        flag("--unload", "then take the indenter away again, by the same depths"),
        arg("--sensitivities", "derivatives to effects: comma-separated names, or all", metavar="NAMES"),
        arg("--out", "the cell's HDF5 file", Path),
        SETTINGS,
        LAWS,
    ),
    "mesh": command(
        "by_hand.mesh.mesh",
        "write the mesh of an indentation for ParaView or Gmsh, nothing is solved",
        *PLACE,
        need("--depth", "deepest depth [mm]: the mesh is fine so far around", float),
        need("--out", ".vtu, .vtk or Gmsh's .msh", Path),
        INDENTER,
        SETTINGS,
    ),
    "characterise": command(
        "by_hand.characterise.characterise_command",
        "fit a constitutive model to material tests; its figure and measured effects",
        *TESTS,
        arg("--laws", "constitutive models to fit, e.g. ogden2,yeoh", default="ogden2"),
        arg("--choose", "which of them is law.json", choices=("aicc", "held_out", "first"), default="aicc"),
        FOLDER,
        arg("--loss", "soft_l1 forgives outliers", choices=("linear", "soft_l1"), default="linear"),
        arg("--bootstrap", "refits over samples, 0 for none", int, default=0),
        arg("--workers", "processes of the bootstrap", int, default=1),
    ),
    "import": command(
        "by_hand.importing.import_command",
        "raw logs of a laboratory (force, stage, camera) to a session folder, with a page that draws what was done",
        arg("mapping", "describes the logs, see docs/importing.md", Path, metavar="MAPPING.yaml"),
        need("--out", "session folder to write: data/<study>/recordings/<session>", Path),
        arg("--data", "folder of the logs; else that of the mapping", Path, metavar="FOLDER"),
        study(text="that is to read the session: its list and its plan file are extended"),
    ),
    "import-set": command(
        "by_hand.importing.import_set",
        "a public set of tactile images with forces to a folder of images and one table, see docs/public-sets.md",
        arg("layout", "how the set is laid out", choices=LAYOUTS),
        arg("source", "folder of the set, or one of its files", Path),
        NEW,
        arg("--every", "take every n-th reading", int, default=1, metavar="N"),
        arg(
            "--columns",
            "of layout table: which column holds image, fx, fy, fz, and where there are such group, reference, time_s,"
            " x_mm, y_mm, z_mm",
            nargs="+",
            default=[],
            metavar="NAME=COLUMN",
        ),
        arg("--unit", "of layout table: unit of the forces", default="N"),
    ),
    "verify": command(
        "by_hand.verify.verify",
        "check the finite elements against solutions from outside; a minute",
        arg("--out", "folder for verification.csv and verification.md", Path),
        arg("--only", "these alone, such as patch_test", nargs="+", metavar="CHECK"),
    ),
    "calibrate": command(
        "by_hand.calibrate.calibrate",
        "moduli, thickness, friction and more of a sensor from its own presses, see docs/calibrate.md",
        arg("recording", "a session's folder, or a folder of sessions", Path),
        MATCHED("what describes the sensor"),
        need(
            "--free",
            "comma-separated: LAYER.modulus, LAYER.exponent, LAYER.thickness, friction, base.compliance, contact_point,"
            " force_gain",
            metavar="NAMES",
        ),
        arg(
            "--prior",
            "what is known before: LOW:HIGH (90 %%) in the parameter's unit, or of a modulus shoreA:10 or shore00:30; a"
            " factor of three about the study's modulus if not given",
            action="append",
            default=[],
            metavar="NAME=PRIOR",
        ),
        FOLDER,
        LAWS,
        *KEPT,
        NO_PAGE("no report.html"),
    ),
    "mismatch-materials": command(
        "by_hand.mismatch_materials.mismatch_materials",
        "what a constitutive model fitted to the fastest loading leaves out of a material's other tests",
        *TESTS,
        FOLDER,
    ),
    "mismatch": command(
        "by_hand.mismatch.mismatch",
        "which physics was left out: judge a recording; `limits`: what the plan could show; `plan`: what to record next",
        arg(
            "what",
            "a session's folder, a folder of sessions, or `limits`, or `plan` (after a verdict in --out)",
        ),
        MATCHED("what is judged against"),
        arg("--out", "folder to write; results/<study>/mismatch if not given", Path),
        LAWS,
        *KEPT,
        NO_PAGE("verdict and tables only, no report.html"),
    ),
    "warm-up": command("by_hand.warm_up.warm_up", "compile the kernels and keep them for later runs"),
    # --- cameras
    "calibrate-camera": command(
        "camera.calibration.calibrate_camera",
        "a camera's focal length, principal point and distortion from images of a board",
        arg("folder", "folder with images of the board", Path),
        need(
            "--board",
            "inner corners of a checkerboard, or squares of a ChArUco board",
            board_size,
            metavar="9x6",
        ),
        need("--square-mm", "side of a square [mm]", float),
        flag("--charuco", "the board has markers in its squares"),
        arg("--marker-mm", "side of a marker [mm]", float),
        arg("--dictionary", "OpenCV's name of the markers", default="DICT_4X4_50"),
        arg("--model", "the lens", choices=("pinhole", "fisheye"), default="pinhole"),
        arg("--largest-rms-px", "refuse a larger reprojection error [px]", float, default=1.0),
        written("YAML"),
        arg("--report", "PNG: corners, residuals, an image without distortion", Path),
    ),
    "camera-pose": command(
        "camera.pose.camera_pose",
        "a camera's position and its turn about z from four indentations or more at known places",
        arg("session", "a session's folder with images", Path),
        arg("--camera", "its calibration; that of session.yaml if not given", Path, metavar="YAML"),
        arg("--plane-z-mm", f"{PLANE} [mm, sensor frame]", float),
        study(text="or the study whose layers carry them"),
        arg("--out", "YAML to write: the camera with its pose", Path),
    ),
    # --- models in use
    "model": command(
        "model.build.model",
        "a model for a shipped sensor, trained on simulated images alone (SYNTHETIC)",
        need("--sensor", "name of a shipped sensor, such as gelsight_mini"),
        arg("--out", "folder to work in; SENSOR_model if not given", Path, metavar="FOLDER"),
        arg("--cores", "processor cores to use", int, default=2),
    ),
    "export": command(  # whose arguments are left out where `dataset` follows
        "model.export.export_model",
        "a trained model as an ONNX file, compared with PyTorch's; export dataset: a dataset in another format",
        study(text="the study whose model is exported", default=SUPPRESS),
        arg("--model", "model.pt of a study, instead of --study", Path, default=SUPPRESS),
        arg("--out", ".onnx file to write; next to the model if not given", Path, default=SUPPRESS),
    ),
    "export dataset": command(
        "model.export.export_dataset",
        "a study's dataset in another format: " + ", ".join(FORMATS),
        need("--format", "see docs/exports.md", dest="form", choices=FORMATS),
        OneOf(
            (study(), arg("--results", "results/<study>, or the folder of a dataset", Path, metavar="FOLDER"))
        ),
        NEW,
        flag("--images", "put the images into the export, compressed"),
        arg(
            "--sample-mb",
            "a part of at most this size: indentations drawn by the study's seed, of every split its share",
            float,
            metavar="MB",
        ),
        arg("--fps", "frames per second of formats that need times; shards hold none", float, default=10.0),
        arg("--licence", "identifier of the licence that you grant, e.g. cc-by-4.0"),
        arg("--published", "date of publication, e.g. 2026-11-27", metavar="DATE"),
    ),
    "predict": command(
        "model.predict.predict",
        "force distribution of images [N], frame by frame, timed",
        *FRAMES,
        arg("--out", "CSV to write: total force and every bin [N], one row per frame", Path),
        arg("--frames", "stop after this many frames", int),
    ),
    "live": command(
        "model.live.live",
        "forces of a camera as they come: a page in the browser, and JSON over a WebSocket for robots",
        *FRAMES,
        arg(
            "--host",
            "address to serve on; others than this machine's own let the network read and command it",
            default="127.0.0.1",
        ),
        arg("--port", "port to serve on; 0: any free one", int, default=8765),
        arg("--record", "record from the start, into this folder", Path, metavar="FOLDER"),
        arg("--max-recordings", "recordings that the folder may hold", int, metavar="N"),
        arg("--max-recording-mb", "size at which a recording ends", float, metavar="MB"),
        arg("--fps", "frames per second of a folder or a video", float, default=30.0),
        flag("--loop", "play a folder or a video again and again"),
        flag("--open", "open the page in the browser", dest="browser"),
    ),
}
