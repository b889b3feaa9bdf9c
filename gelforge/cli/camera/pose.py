"""`gelforge camera-pose`: where a camera is, from presses at known places."""

from __future__ import annotations

from pathlib import Path


def camera_pose(
    session: Path, camera: Path | None, plane_z_mm: float | None, study: Path | None, out: Path | None
) -> None:
    """Find the camera's position and turn from a session's presses, print how well, write the completed camera."""
    from gelforge.config import ConfigError, load_camera, load_study, write_yaml
    from gelforge.recording.camera_pose import fit_pose, particle_plane_mm, press_centres
    from gelforge.recording.readings import read_recording

    recording = read_recording(session)
    unposed = {"position_mm": [0.0, 0.0, -1000.0]}  # far below any port; found anew
    known = load_camera(camera, **unposed) if camera else recording.session.camera
    if known is None:
        raise ConfigError(f"{session / 'session.yaml'}: no camera; describe it there or give --camera")
    if plane_z_mm is not None:
        plane = plane_z_mm
    elif study is not None:
        plane = particle_plane_mm(load_study(study).sensor)
    else:
        raise ConfigError(
            "the height of the particles is not known; give --study with their layer, or --plane-z-mm"
        )
    names, places, centres = press_centres(recording, known)
    pose = fit_pose(known, names, places, centres, plane)
    for line in pose_lines(pose, plane):
        print(line)
    if out:
        write_yaml(out, {"camera": pose.camera.model_dump(mode="json")})
        print(f"written to {out}")


def pose_lines(pose, plane_z_mm: float) -> list[str]:
    """Return a pose with its standard deviations as lines: what was fitted, what was held, and what that means."""
    from gelforge.recording.camera_pose import UNITS, UNKNOWNS

    camera = pose.camera
    values = [*camera.position_mm, camera.rotation_deg[2]]
    lines = [f"presses    {len(pose.places_mm)}, {pose.rms_px:.2f} px rms from where the camera has them"]
    lines += [f"left out   {name}: {reason}" for name, reason in pose.left_out.items()]
    for name, value, sd, unit in zip(UNKNOWNS, values, pose.sd, UNITS):
        lines.append(f"{name:12} {value:.3f} +- {sd:.3f} {unit}")
    lines.append(
        f"held       turns about x and y ({camera.rotation_deg[0]:g}, {camera.rotation_deg[1]:g} deg), lens, port: a tilt "
        f"of 1 deg moves the position by {pose.per_tilt_mm:.2f} mm and the residual by {pose.per_tilt_px:.2f} px only"
    )
    lines.append(
        f"plane      z = {plane_z_mm:g} mm: only the distance from it shows, and that to some 5 % (docs/cameras.md); "
        "standard deviations are of the scatter alone"
    )
    lines.append(scale_line(camera, plane_z_mm))
    return lines


def scale_line(camera, plane_z_mm: float) -> str:
    """Return the scale of a camera's image in its middle, and of which plane it is."""
    from gelforge.recording.optics.camera import mm_per_px_at

    return (
        f"scale      {mm_per_px_at(camera, plane_z_mm):.4g} mm/px in the image's middle, on the plane z = {plane_z_mm:g} mm "
        "of the sensor frame"
    )
