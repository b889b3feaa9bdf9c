"""Arguments of the commands by hand: press, mesh, characterise, import, verify, calibrate, mismatch and its relatives."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from gelforge.cli.common import add_command, add_laws, add_study
from gelforge.importing.public import NAMES as LAYOUTS


def depth_list(text: str) -> list[float]:
    """Return increasing depths [mm] from `0.25:2:0.25` (first:last:step) or `0.5,1,2`."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = math.floor((last - first) / step + 1e-9) + 1
            depths = [round(first + i * step, 9) for i in range(count)]
        else:
            depths = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError):
        raise argparse.ArgumentTypeError(
            f"{text!r}: write first:last:step or a comma-separated list"
        ) from None
    if not depths or depths[0] <= 0 or any(b <= a for a, b in zip(depths, depths[1:])):
        raise argparse.ArgumentTypeError(f"{text!r} gives {depths}; depths must be positive and increase")
    return depths


def add(commands) -> None:
    """Add the commands by hand."""
    _press(commands)
    _mesh(commands)
    _characterise(commands)
    _import_logs(commands)
    _import_set(commands)
    _verify(commands)
    _calibrate(commands)
    _mismatch_materials(commands)
    _mismatch(commands)
    add_command(
        commands, "warm-up", "by_hand.warm_up.warm_up", "compile the kernels and keep them for later runs"
    )


def _press(commands) -> None:
    press = add_command(
        commands, "press", "by_hand.press.press", "press once on a sensor and print the force-depth table"
    )
    press.add_argument("--x", type=float, required=True, help="position along x [mm], origin at the corner")
    press.add_argument("--y", type=float, required=True, help="position along y [mm]")
    press.add_argument(
        "--depths",
        type=depth_list,
        required=True,
        help="depths [mm]: first:last:step, or a comma-separated list",
    )
    press.add_argument(
        "--indenter", type=Path, metavar="YAML", help="any indenter, see config/indenters; else the study's"
    )
    press.add_argument(
        "--shear",
        type=float,
        nargs=2,
        metavar=("X", "Y"),
        help="then move sideways by this [mm] at the last depth",
    )
    press.add_argument(
        "--twist",
        type=float,
        default=0.0,
        metavar="DEG",
        help="then turn the indenter about z by this [deg]; the table shows the torque",
    )
    press.add_argument(
        "--unload", action="store_true", help="then take the indenter away again, by the same depths"
    )
    press.add_argument(
        "--sensitivities", metavar="NAMES", help="derivatives to effects: comma-separated names, or all"
    )
    press.add_argument("--out", type=Path, help="the cell's HDF5 file")
    add_study(press, text="whose sensor and settings are used; the article's if not given")
    add_laws(press, nargs="*", default=[])


def _mesh(commands) -> None:
    mesh = add_command(
        commands,
        "mesh",
        "by_hand.mesh.mesh",
        "write the mesh of an indentation for ParaView or Gmsh, nothing is solved",
    )
    mesh.add_argument("--x", type=float, required=True, help="position along x [mm], origin at the corner")
    mesh.add_argument("--y", type=float, required=True, help="position along y [mm]")
    mesh.add_argument(
        "--depth", type=float, required=True, help="deepest depth [mm]: the mesh is fine so far around"
    )
    mesh.add_argument("--out", type=Path, required=True, help=".vtu, .vtk or Gmsh's .msh")
    mesh.add_argument(
        "--indenter", type=Path, metavar="YAML", help="any indenter, see config/indenters; else the study's"
    )
    add_study(mesh, text="whose sensor and settings are used; the article's if not given")


def _characterise(commands) -> None:
    characterise = add_command(
        commands,
        "characterise",
        "by_hand.characterise.characterise_command",
        "fit a constitutive model to material tests; its figure and measured effects",
    )
    characterise.add_argument(
        "sources", type=Path, nargs="+", help="folders with samples.csv or small tests, or files"
    )
    characterise.add_argument(
        "--mapping", type=Path, help="YAML that describes the files, see config/mappings"
    )
    characterise.add_argument("--laws", default="ogden2", help="constitutive models to fit, e.g. ogden2,yeoh")
    characterise.add_argument(
        "--choose",
        choices=("aicc", "held_out", "first"),
        default="aicc",
        help="which of them is law.json",
    )
    characterise.add_argument("--out", type=Path, required=True, help="folder to write")
    characterise.add_argument(
        "--loss", choices=("linear", "soft_l1"), default="linear", help="soft_l1 forgives outliers"
    )
    characterise.add_argument("--bootstrap", type=int, default=0, help="refits over samples, 0 for none")
    characterise.add_argument("--workers", type=int, default=1, help="processes of the bootstrap")


def _import_logs(commands) -> None:
    raw = add_command(
        commands,
        "import",
        "by_hand.importing.import_command",
        "raw logs of a laboratory (force, stage, camera) to a session folder, with a page that draws what was done",
    )
    raw.add_argument(
        "mapping", type=Path, metavar="MAPPING.yaml", help="describes the logs, see docs/importing.md"
    )
    raw.add_argument(
        "--out", type=Path, required=True, help="session folder to write: data/<study>/recordings/<session>"
    )
    raw.add_argument(
        "--data", type=Path, metavar="FOLDER", help="folder of the logs; else that of the mapping"
    )
    add_study(raw, text="that is to read the session: its list and its plan file are extended")


def _import_set(commands) -> None:
    public = add_command(
        commands,
        "import-set",
        "by_hand.importing.import_set",
        "a public set of tactile images with forces to a folder of images and one table, see docs/public-sets.md",
    )
    public.add_argument("layout", choices=LAYOUTS, help="how the set is laid out")
    public.add_argument("source", type=Path, help="folder of the set, or one of its files")
    public.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="new folder to write")
    public.add_argument("--every", type=int, default=1, metavar="N", help="take every n-th reading")
    public.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="NAME=COLUMN",
        help="of layout table: which column holds image, fx, fy, fz, and where there are such group, reference, time_s,"
        " x_mm, y_mm, z_mm",
    )
    public.add_argument("--unit", default="N", help="of layout table: unit of the forces")


def _verify(commands) -> None:
    verify = add_command(
        commands,
        "verify",
        "by_hand.verify.verify",
        "check the finite elements against solutions from outside; a minute",
    )
    verify.add_argument("--out", type=Path, help="folder for verification.csv and verification.md")
    verify.add_argument("--only", nargs="+", metavar="CHECK", help="these alone, such as patch_test")


def _calibrate(commands) -> None:
    calibrate = add_command(
        commands,
        "calibrate",
        "by_hand.calibrate.calibrate",
        "moduli, thickness, friction and more of a sensor from its own presses, see docs/calibrate.md",
    )
    calibrate.add_argument("recording", type=Path, help="a session's folder, or a folder of sessions")
    add_study(
        calibrate, "--study", "--config", dest="config", required=True, text="what describes the sensor"
    )
    calibrate.add_argument(
        "--free",
        required=True,
        metavar="NAMES",
        help="comma-separated: LAYER.modulus, LAYER.exponent, LAYER.thickness, friction, base.compliance, contact_point,"
        " force_gain",
    )
    calibrate.add_argument(
        "--prior",
        action="append",
        default=[],
        metavar="NAME=PRIOR",
        help="what is known before: LOW:HIGH (90 %%) in the parameter's unit, or of a modulus shoreA:10 or shore00:30; a"
        " factor of three about the study's modulus if not given",
    )
    calibrate.add_argument("--out", type=Path, required=True, help="folder to write")
    add_laws(calibrate, nargs="*", default=[])
    calibrate.add_argument("--kept", type=Path, help="folder of kept solutions; solves in --out if not given")
    calibrate.add_argument("--workers", type=int, default=1, help="indentations that are solved side by side")
    calibrate.add_argument("--no-page", dest="page", action="store_false", help="no report.html")


def _mismatch_materials(commands) -> None:
    tests = add_command(
        commands,
        "mismatch-materials",
        "by_hand.mismatch_materials.mismatch_materials",
        "what a constitutive model fitted to the fastest loading leaves out of a material's other tests",
    )
    tests.add_argument(
        "sources", type=Path, nargs="+", help="folders with samples.csv or small tests, or files"
    )
    tests.add_argument("--mapping", type=Path, help="YAML that describes the files, see config/mappings")
    tests.add_argument("--out", type=Path, required=True, help="folder to write")


def _mismatch(commands) -> None:
    mismatch = add_command(
        commands,
        "mismatch",
        "by_hand.mismatch.mismatch",
        "which physics was left out: judge a recording; `limits`: what the plan could show; `plan`: what to record next",
    )
    mismatch.add_argument(
        "what",
        help="a session's folder, a folder of sessions, or `limits`, or `plan` (after a verdict in --out)",
    )
    add_study(mismatch, "--study", "--config", dest="config", required=True, text="what is judged against")
    mismatch.add_argument("--out", type=Path, help="folder to write; results/<study>/mismatch if not given")
    add_laws(mismatch, nargs="*", default=[])
    mismatch.add_argument("--kept", type=Path, help="folder of kept solutions; solves in --out if not given")
    mismatch.add_argument("--workers", type=int, default=1, help="indentations that are solved side by side")
    mismatch.add_argument(
        "--no-page", dest="page", action="store_false", help="verdict and tables only, no report.html"
    )
