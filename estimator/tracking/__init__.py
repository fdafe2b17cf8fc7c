"""Bearing stiffness that changes while the machine runs: followed sample by sample.

===================  ======================================================  =======================
module               what it holds                                           start here
===================  ======================================================  =======================
``reduced_rotor``    the rotor with few coordinates, as an FMU carries it    ``ReducedRotor``
``reduction``        such a rotor made of a finite-element model             ``reduce_rotor``
``tracker``          the Kalman filter                                       ``StiffnessTracker``
``monitor``          has the machine changed, and what                       ``GapMonitor``
===================  ======================================================  =======================
"""
