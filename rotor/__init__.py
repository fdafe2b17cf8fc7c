"""The rotor model: geometry, finite elements, effects, and everything that solves them.

======================  =================================================================  ==========================
module                  what it holds                                                      start here
======================  =================================================================  ==========================
``rig``                 the rig TOML and the shipped rigs                                  ``load_rig``
``elements``            beam elements from their shape functions                           ``timoshenko``
``assembly``            rig to matrices                                                    ``assemble``
``structure``           free-free matrices and the supports' places                        ``Structure``
``condition``           how the rotor is held, driven and spun                             ``Condition``
``effects``             what reality may have and the nominal rotor lacks                  ``EFFECTS``
``design``              the rotor while effects are put into it                            ``Design``
``force_laws``          local force laws, each written once                                ``ForceLaw``
``printed_laws``        the laws as code, printed by ``build_laws.py``
``local_force``         a law at a joint                                                   ``LocalForce``
``model``               structure, condition and effects to matrices                       ``build_model``
``system``              the linear rotor, its modes and damping                            ``LinearSystem``
``state_space``         the first-order form that all solvers share                        ``StateSpace``
``condensation``        static (Guyan) condensation                                        ``condense_tilt``
``modal``               natural frequencies, damped modes                                  ``natural_frequencies_hz``
``whirl``               Campbell diagram, critical speeds, unbalance                       ``campbell``
``frequency_response``  linear receptance and accelerance                                  ``accelerance``
``measured``            what a rig without noise reports, its sensors and exciter with it  ``measured_response``
``harmonic_balance``    periodic response with local force laws                            ``Balance``
``periodic_force``      local forces during a periodic motion                              ``PeriodicForces``
``continuation``        response curves through their folds                                ``trace``
``stability``           Floquet multipliers of periodic motions                            ``floquet_multipliers``
``stepper``             exact time stepping of the linear rotor                            ``ModalStepper``
``nonlinear_stepper``   time stepping with local force laws                                ``NonlinearStepper``
``drive``               forces during one step: held ones and pure tones                   ``Drive``
``simulator``           the rotor with a clock and a sine generator                        ``RotorSimulator``
======================  =================================================================  ==========================

Conventions: x along the shaft, spin about +x, nodal coordinates ``(y, z, theta_y, theta_z)``,
time factor e^{+i omega t}, peak amplitudes, SI units. Nodes count from 1.
"""
