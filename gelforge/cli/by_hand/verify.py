"""`gelforge verify`: the finite elements next to independent reference solutions."""

from __future__ import annotations

from pathlib import Path


def verify(out: Path | None, only: list[str] | None) -> None:
    """Run checks of the finite elements, all if none is named, print and write the table; fail beyond a limit."""
    from gelforge.files import write_table
    from gelforge.verification import VerificationFailed, check_table
    from gelforge.verification.run import CHECKS, run_checks

    if unknown := set(only or []) - set(CHECKS):
        raise VerificationFailed(f"--only {', '.join(sorted(unknown))}: the checks are {', '.join(CHECKS)}")
    checks = []
    for check in run_checks(only or list(CHECKS)):
        checks.append(check)
        print(
            f"{'ok' if check.passed else 'FAILED':8}{check.quantity}: {check.found:.6g}, error {check.error:.1e}"
        )
    if out is not None:
        write_table(out, "verification", check_table(checks))
    failed = [f"{c.quantity} (error {c.error:.1e}, limit {c.limit:.1e})" for c in checks if not c.passed]
    if failed:
        raise VerificationFailed(f"{len(failed)} of {len(checks)} checks failed: {'; '.join(failed)}")
