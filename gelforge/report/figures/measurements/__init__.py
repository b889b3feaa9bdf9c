"""What was measured: material tests next to their constitutive models, calibrations, imported logs, optical flow."""
