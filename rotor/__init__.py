"""The rotor model: geometry, finite elements, effects, and everything that solves them.

==============  ==========================================================================  =====================
room            what it holds                                                               start here
==============  ==========================================================================  =====================
``model``       structure, condition and effects to matrices, modes and damping             ``build_model``
``geometry``    the rig TOML, the shipped rigs, and the mesh                                 ``load_rig``
``effects``     what reality may have and the nominal rotor lacks                           ``EFFECTS``
``frequency``   frequency responses, modes, Campbell diagrams, harmonic balance             ``accelerance``
``time``        exact time stepping, with local forces too; the rotor with a clock          ``RotorSimulator``
==============  ==========================================================================  =====================

``rigs`` holds the shipped rigs. What runs inside ``RotorRig.fmu`` is ``model``, ``effects`` and ``time``.

Conventions: x along the shaft, spin about +x, nodal coordinates ``(y, z, theta_y, theta_z)``,
time factor e^{+i omega t}, peak amplitudes, SI units. Nodes count from 1. Examples in docstrings use
``np``, ``load_rig``, ``assemble``, ``build_system`` and ``Condition`` without importing them.
"""
