"""The rotor model: geometry, finite elements, modes, frequency response, exact time stepping.

=========================  ==================================================  =====================
module                     what it holds                                       start here
=========================  ==================================================  =====================
``rig``                    the rig TOML and the shipped rigs                   ``load_rig``
``elements``               beam elements from their shape functions            ``timoshenko``
``assembly``               rig to matrices                                     ``assemble``
``structure``              free-free matrices and the supports' places         ``Structure``
``system``                 one support condition with its damping              ``build_system``
``condensation``           static (Guyan) condensation                         ``condense_tilt``
``modal``                  natural frequencies, damped modes, Campbell         ``natural_frequencies_hz``
``frequency_response``     direct receptance and accelerance                   ``accelerance``
``stepper``                exact time stepping under a sine                    ``ModalStepper``
=========================  ==================================================  =====================

Conventions: x along the shaft, spin about +x, nodal coordinates ``(y, z, theta_y, theta_z)``,
time factor e^{+i omega t}, peak amplitudes, SI units. Nodes count from 1.
"""
