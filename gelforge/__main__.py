"""`python -m gelforge`: the command line."""

import sys

from gelforge.cli import main

sys.exit(main())
