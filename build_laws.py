"""Print the force laws anew, for Python and for C: ``python build_laws.py``."""

import sys

from rigtwin.fmu_src.print_laws import main

if __name__ == "__main__":
    sys.exit(main())
