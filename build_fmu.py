"""Build the FMUs: ``python build_fmu.py`` writes both into ``dist/``, with ``--native`` those without Python, too.

The functions are those of ``rigtwin.fmu_src.build``.
"""

import sys

from rigtwin.fmu_src.build import (
    build_estimator_fmu,
    build_native_estimator_fmu,
    build_native_rotor_fmu,
    build_rotor_fmu,
    main,
)

__all__ = ["build_estimator_fmu", "build_native_estimator_fmu", "build_native_rotor_fmu", "build_rotor_fmu", "main"]

if __name__ == "__main__":
    sys.exit(main())
