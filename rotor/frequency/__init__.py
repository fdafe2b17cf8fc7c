"""The rotor in the frequency domain.

======================  =================================================================  ==========================
module                  what it holds                                                      start here
======================  =================================================================  ==========================
``modal``               natural frequencies, damped modes, what a table lists of them      ``listed_modes``
``shapes``              shapes of modes along the shaft, and orbits                        ``shaft_shapes``
``whirl``               Campbell diagram, critical speeds, unbalance                       ``campbell``
``stiffness_map``       critical speeds and frequencies over bearing stiffness             ``critical_speed_map``
``frequency_response``  linear receptance and accelerance                                  ``accelerance``
``measured``            what a rig without noise reports, its sensors and exciter with it  ``measured_response``
``harmonic_balance``    periodic response with local force laws                            ``Balance``
``periodic_force``      local forces during a periodic motion                              ``PeriodicForces``
``continuation``        response curves through their folds                                ``trace``
``stability``           Floquet multipliers of periodic motions                            ``floquet_multipliers``
======================  =================================================================  ==========================
"""
