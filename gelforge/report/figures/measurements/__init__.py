"""What was measured: material tests beside their constitutive models, calibrations, imported logs, optical flow."""
