"""`gelforge calibrate-camera`: a camera's lens from images of a board."""

from __future__ import annotations

from pathlib import Path


def calibrate_camera(
    folder: Path,
    board: tuple[int, int],
    square_mm: float,
    charuco: bool,
    marker_mm: float | None,
    dictionary: str,
    model: str,
    largest_rms_px: float,
    out: Path,
    report: Path | None,
) -> None:
    """Calibrate a camera, print how well, write its keys for session.yaml and a picture of what they lean on."""
    from gelforge.files import write_text
    from gelforge.recording.optics.boards import Board, CalibrationError, find_boards
    from gelforge.recording.optics.calibration import calibrate

    if charuco != (marker_mm is not None):
        raise CalibrationError(
            "--charuco and --marker-mm belong together: the side of the markers in a ChArUco board [mm]"
        )
    described = Board(*board, square_mm, marker_mm, dictionary)
    calibration = calibrate(find_boards(folder, described), described, model, largest_rms_px)
    for line in calibration_lines(calibration):
        print(line)
    write_text(out, camera_text(calibration))
    print(f"written to {out}")
    if report:
        from gelforge.recording.imaging.flow import read_grey
        from gelforge.recording.optics.calibration import without_distortion
        from gelforge.report.figures.measurements.calibration_figure import calibration_figure

        example = read_grey(folder / calibration.views.seen[0].name)
        straight = without_distortion(calibration, example)
        calibration_figure(calibration, example, straight).savefig(report, dpi=110)
        print(f"picture    {report}")


def calibration_lines(lens) -> list[str]:
    """Return what a calibration found, as lines: images, errors, intrinsics with their standard deviations."""
    views, worst = lens.views, int(lens.view_rms_px.argmax())
    lines = [f"board      {lens.board.words}; model {lens.model}"]
    lines.append(f"images     {len(views.seen)} of {len(views.seen) + len(views.left_out)} used")
    lines += [f"left out   {name}: {reason}" for name, reason in views.left_out.items()]
    if views.mirrored is not None:
        lines.append("mirrored   " + ("yes: markers are seen mirrored" if views.mirrored else "no"))
    lines.append(
        f"error      {lens.rms_px:.3f} px rms; worst image {views.seen[worst].name}: {lens.view_rms_px[worst]:.3f} px"
    )
    lines.append(
        f"covered    {lens.covered:.0%} of the image; boards up to {lens.tilts_deg().max():.0f} deg from their mean"
    )
    from gelforge.config.parts.camera import LENS

    names = ["focal u", "focal v", "centre u", "centre v", *LENS[lens.model]]
    values = [*lens.K[[0, 1, 0, 1], [0, 1, 2, 2]], *lens.coefficients]
    for name, value, sd in zip(names, values, lens.intrinsics_sd):
        lines.append(f"{name:10} {value:.6g} +- {sd:.2g}{' px' if ' ' in name else ''}")
    lines.append(
        f"scale      {1e3 * 10 / lens.K[0, 0]:.3g} um/px at 10 mm from the pinhole, in proportion to the distance; "
        "`gelforge camera-pose` and `gelforge check` print it at the plane of the particles"
    )
    return lines


def camera_text(fit) -> str:
    """Return the calibration as YAML: the keys of session.yaml's camera, and what is to be added."""
    keys, views = fit.keys, fit.views
    lens = keys["distortion"]
    known = {None: "true # or false: a checkerboard does not show it", True: "true", False: "false"}
    return f"""\
# {fit.board.words}; {len(views.seen)} images, {fit.rms_px:.3f} px rms, focal length +- {fit.intrinsics_sd[0]:.2g} px.
# Paste into session.yaml. It holds for images as recorded at this size, mirrored or not, in this focus.
camera:
  width_px: {keys["width_px"]}
  height_px: {keys["height_px"]}
  focal_px: {keys["focal_px"]}
  focal_y_px: {keys["focal_y_px"]}
  centre_px: {keys["centre_px"]}
  distortion: {{model: {lens["model"]}, coefficients: {lens["coefficients"]}}}
  # The pose, from a drawing or by `gelforge camera-pose`, which writes it:
  # position_mm: [16.0, 16.0, -46.0] # the pinhole, in the sensor frame
  # rotation_deg: [0.0, 0.0, 0.0] # turns about x, then y, then z, from looking straight up
  # mirrored: {known[views.mirrored]}
  # port: {{z_mm: -6.0, index: 1.41}} # where air ends and the gel begins, unless the camera is cast in
"""
