"""What goes inside the FMUs.

=======================  ====================================================================================
module                   what it holds
=======================  ====================================================================================
``variables``            what a variable of an FMU is, and the units
``rotor_variables``      the variables of RotorRig: the one place where their names stand
``estimator_variables``  the variables of StiffnessEstimator
``tracker_variables``    the variables of StiffnessTracker
``monitor_variables``    the variables of GapMonitor
``machine_variables``    the variables of SofteningBearing and SpeedSupervisor
``model_description``    modelDescription.xml of a variable table, FMI 2.0 and 3.0
``slave``                a pythonfmu slave driven by such a table
``rotor_slave``          RotorRig, the rotor as a co-simulation FMU
``estimator_slave``      StiffnessEstimator, the network as a co-simulation FMU
``listening_slave``      what tracker and monitor share as slaves
``tracker_slave``        StiffnessTracker, the Kalman filter as a co-simulation FMU
``monitor_slave``        GapMonitor, the watch over a machine as a co-simulation FMU
``staging``              bundles sources under names no host can own
``documentation``        the FMU's picture and its HTML page
``beside``               licences, terminals, a reference run and facts inside each FMU
``reference_runs``       the runs whose results each FMU holds
``native_sources``       C sources of an FMU without Python inside: ``native/`` and what is printed for a rig
``network_code``         C code of a small ONNX network
``tracker_network_code`` the weights of a tracker's network as C
``compiling``            C sources to shared libraries
``ssp``                  FMUs wired into one system
``build``                builds the FMUs: stage, compile, complete, validate
``machine``              a machine whose bearing softens: two small FMUs, and the system of four
``built_here``           which FMUs this installation has built, by their hashes
``print_laws``           the force laws as Python and as C
=======================  ====================================================================================

The slaves are thin: set, one physics call, get.
"""
