"""``python -m raytrace``: the same as the script ``raytrace``."""

import sys

from raytrace.cli import main

if __name__ == "__main__":
    sys.exit(main())
