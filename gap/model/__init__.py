"""The model of the measured runs: rotors with candidate effects, built and solved at every run's lines.

==================  ============================================================  ====================
module              what it holds                                                 start here
==================  ============================================================  ====================
``campaign_model``  the model of a campaign's rig, meshed finely enough           ``forward_of``
``forward``         rotors built and solved for runs, remembered                  ``Forward``
``run_model``       what the diagnosis may ask of a run's model                   ``RunModel``
``linear``          a linear run's response, resonance by resonance               ``Modal``
``workshop``        what a workshop knows of a rig only within a tolerance        ``Workshop``
``tolerances``      how these numbers bend the modes                              ``bend_of``
``transients``      what a fast sweep leaves of a rotor's transients              ``transients``
``nonlinear``       a run's response under a force law, by harmonic balance       ``NonlinearModal``
``motions``         motions under a force law, and how a run drives and reads     ``Drive``
``branch``          the branch of motions that the run's data are on              ``Branch``
``sweep``           motions of a run without data, followed along its sweep       ``follow_sweep``
``motion_slopes``   derivatives of a response under a force law                   ``MotionSlopes``
==================  ============================================================  ====================
"""
