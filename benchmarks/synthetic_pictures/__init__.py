"""SYNTHETIC pictures with known motion, for benchmarks and tests: stretched films, membranes, calibration boards."""
