"""What goes inside the FMUs.

=========================  ===========================================================
module                     what it holds
=========================  ===========================================================
``variables``              the variable tables of both FMUs: the one place names stand
``slave``                  a pythonfmu slave driven by such a table
``rotor_slave``            RotorRig, the rotor as a co-simulation FMU
``estimator_slave``        StiffnessEstimator, the network as a co-simulation FMU
``staging``                bundles sources under names no host can own
``documentation``          the FMU's picture and its HTML page
=========================  ===========================================================

The slaves are thin: set, one physics call, get.
"""
