"""What holds for pythonfmu's FMUs holds for the self-contained ones: the same tests, on the fixtures of this folder."""

from tests.fmu.test_contract import *  # noqa: F403
from tests.fmu.test_effects import *  # noqa: F403
from tests.fmu.test_force_signal import *  # noqa: F403
from tests.fmu.test_model_description import *  # noqa: F403
from tests.fmu.test_physics import *  # noqa: F403
from tests.fmu.test_reference_run import *  # noqa: F403
from tests.fmu.test_refusals import *  # noqa: F403
from tests.fmu.test_state import *  # noqa: F403
from tests.fmu.test_steps import *  # noqa: F403
