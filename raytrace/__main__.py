"""``python -m raytrace``: the same as the script ``raytrace``."""

import sys

from raytrace.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
