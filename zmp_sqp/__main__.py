"""`python -m zmp_sqp`: the command line, as `zmp-sqp`."""

from __future__ import annotations

import sys

from zmp_sqp.cli import main

if __name__ == "__main__":
    sys.exit(main())
