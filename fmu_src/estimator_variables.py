"""The variables of ``StiffnessEstimator.fmu``."""

from __future__ import annotations

from rigtwin.fmu_src.variables import Variable

ESTIMATOR_MEANING = "Bearing stiffness from the frequency shifts and the amplitude ratio of a stepped-sine test"
ESTIMATOR_STEP = 1.0  # of the default experiment [s]
ESTIMATOR_TOLERANCE = 1e-6  # the network computes in single precision


def estimator_variables(starts: dict[str, float]) -> tuple[Variable, ...]:
    """Variables of ``StiffnessEstimator.fmu``; ``starts`` is a consistent set of measured values."""
    what = {
        "delta_f1": ("Shift of the first resonance, rigid minus bearing support", "Hz"),
        "delta_f2": ("Shift of the second resonance, rigid minus bearing support", "Hz"),
        "amplitude_ratio": ("A1/A0: first-mode resonance acceleration at node 2, bearing over rigid support", "1"),
    }
    values = tuple(Variable(name, "input", text, unit, starts[name]) for name, (text, unit) in what.items())
    errors = tuple(
        Variable(f"{name}_std", "input", f"Standard error of {name}", unit, starts[f"{name}_std"], 0.0)
        for name, (_, unit) in what.items()
    )
    every = tuple(v.name for v in (*values, *errors))
    outputs = (
        ("k_b", "Radial stiffness of each bearing"),
        ("k_b_std", "Standard deviation of k_b"),
        ("k_b_low", "Lower end of the 90 % interval of k_b"),
        ("k_b_high", "Upper end of the 90 % interval of k_b"),
    )
    return (
        *values,
        *errors,
        *(
            Variable(name, "output", text, "N/m", depends_on=every, initially_depends_on=every)
            for name, text in outputs
        ),
        Variable(
            "valid",
            "output",
            "False outside the training range or when the inputs contradict each other",
            depends_on=every,
            initially_depends_on=every,
            boolean=True,
        ),
    )
