"""The same as `gelforge unlock`, by the path that it had before."""

import sys

from gelforge.cli import main

sys.exit(main(["unlock"]))
