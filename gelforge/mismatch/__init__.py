"""Where simulation and recording differ, which physics was left out, its model, and what it explains of data not seen."""
