"""Set-up of every test: one thread for the numerical libraries, kernels kept between runs, no time limit for an example."""

import os

# Before numpy is imported: two cores are shared by what runs beside the tests, and sums keep their order.
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from hypothesis import HealthCheck, settings  # noqa: E402

from gelforge.cli import keep_compiled_kernels  # noqa: E402

keep_compiled_kernels()
# A busy machine is no failure: by default an example may take 0.2 s.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")
