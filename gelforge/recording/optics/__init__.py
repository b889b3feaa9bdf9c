"""The camera: lens, refraction, calibration."""
