"""Set-up of every test: one thread for the numerical libraries, kernels kept between runs."""

import os

# Before numpy is imported: two cores are shared by what runs beside the tests, and sums keep their order.
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from gelforge.cli import keep_compiled_kernels  # noqa: E402

keep_compiled_kernels()
