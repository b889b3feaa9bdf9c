"""Checks of the finite elements against independent reference solutions, shared by the tests and the report's table.

`run.CHECKS` has them in the order of the table; they load the compiled kernels and are imported where they run.
"""

from gelforge.verification.check import Check, VerificationFailed, check_table
