"""The rotor in the frequency domain.

======================  =================================================================  ==========================
module                  what it holds                                                      start here
======================  =================================================================  ==========================
``modal``               natural frequencies, damped modes                                  ``natural_frequencies_hz``
``whirl``               Campbell diagram, critical speeds, unbalance                       ``campbell``
``frequency_response``  linear receptance and accelerance                                  ``accelerance``
``measured``            what a rig without noise reports, its sensors and exciter with it  ``measured_response``
``harmonic_balance``    periodic response with local force laws                            ``Balance``
``periodic_force``      local forces during a periodic motion                              ``PeriodicForces``
``continuation``        response curves through their folds                                ``trace``
``stability``           Floquet multipliers of periodic motions                            ``floquet_multipliers``
======================  =================================================================  ==========================
"""
