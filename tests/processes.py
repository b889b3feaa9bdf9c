"""Whether processes that are not our children have ended."""

import psutil


def ended(process: int) -> bool:
    """Return whether it has ended; one that its parent has not yet taken note of has, and in some containers none ever is.

    There the first process, which inherits those whose parent has gone, waits for no child.
    """
    try:
        return psutil.Process(process).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True
