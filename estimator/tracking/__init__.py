"""Bearing stiffness that changes while the machine runs: followed sample by sample.

===================  ======================================================  =======================
module               what it holds                                           start here
===================  ======================================================  =======================
``reduced_rotor``    the rotor with few coordinates, as an FMU carries it    ``ReducedRotor``
``reduction``        such a rotor made of a finite-element model             ``reduce_rotor``
``tracker``          the Kalman filter                                       ``StiffnessTracker``
``network``          the network in use: numpy and onnxruntime only          ``NetworkTracker``
``streams``          rotors that run while k_b changes, by the FMU           ``make_streams``
``training``         such a network fitted and calibrated                    ``train``
``network_file``     such a network as an ONNX file                          ``export``
``monitor``          has the machine changed, and what                       ``GapMonitor``
===================  ======================================================  =======================

torch is imported by ``training`` and ``network_file`` only.
"""

from pathlib import Path

TRACKER_CARD = "rigtwin tracker"  # what the network of a tracker calls itself


def shipped_tracker() -> Path:
    """Path of the trained network that comes with rigtwin."""
    return Path(__file__).parents[1] / "model" / "tracker.onnx"
