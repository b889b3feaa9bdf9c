"""What a fork of this process does before it ends."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from typing import NoReturn


def end_with(run: Callable[[], int | None]) -> NoReturn:
    """Run something in a fork, and end the fork with the exit status that it returns or raises; 70: another exception."""
    status = 70
    try:
        status = run() or 0
    except SystemExit as ended:
        status = ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
