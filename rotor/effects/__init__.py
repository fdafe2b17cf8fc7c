"""The effect library: what a real rig may have and the nominal rotor does not have.

================  ==========================================================
module            what it holds
================  ==========================================================
``effect``        what an effect is: parameters, places, what it may add
``structure``     masses, shaft, disks, cracks
``supports``      bearings and what they stand on
``nonlinear``     local force laws at the bearings or at a node
``chain``         sensors, exciter, raster and sweep
``spinning``      gyroscopic moments and unbalance
``library``       all of them by id
================  ==========================================================

A new effect is one class in one of these modules, and its name here; docs/new-effect.md says what else it takes.
"""

from __future__ import annotations

from rigtwin.rotor.effects.chain import (
    CoarseGrid,
    FastSweep,
    ForceDropout,
    SensorDelay,
    SensorGain,
    SensorMass,
    SensorPosition,
)
from rigtwin.rotor.effects.effect import Effect, Parameter, Place
from rigtwin.rotor.effects.library import EFFECTS
from rigtwin.rotor.effects.nonlinear import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Rub,
)
from rigtwin.rotor.effects.spinning import Gyroscopic, UnbalanceForce
from rigtwin.rotor.effects.structure import (
    AttachedMass,
    AxialLoad,
    DiskInertia,
    DiskMass,
    ExciterSuspension,
    HubStiffening,
    OpenCrack,
    ShaftDamping,
    ShaftModulus,
    known_mass,
)
from rigtwin.rotor.effects.supports import (
    BearingAsymmetry,
    BearingDamping,
    BearingOffset,
    BearingTiltStiffness,
    CompliantRigidSupport,
    PedestalFlexibility,
    PlaneAnisotropy,
    ViscoelasticSupport,
)

__all__ = [
    "EFFECTS",
    "AttachedMass",
    "AxialLoad",
    "BearingAsymmetry",
    "BearingClearance",
    "BearingCubic",
    "BearingDamping",
    "BearingFriction",
    "BearingHertz",
    "BearingOffset",
    "BearingTiltStiffness",
    "BilinearSupport",
    "CoarseGrid",
    "CompliantRigidSupport",
    "DiskInertia",
    "DiskMass",
    "Effect",
    "ExciterSuspension",
    "FastSweep",
    "ForceDropout",
    "Gyroscopic",
    "HubStiffening",
    "OpenCrack",
    "Parameter",
    "PedestalFlexibility",
    "Place",
    "PlaneAnisotropy",
    "Rub",
    "SensorDelay",
    "SensorGain",
    "SensorMass",
    "SensorPosition",
    "ShaftDamping",
    "ShaftModulus",
    "UnbalanceForce",
    "ViscoelasticSupport",
    "known_mass",
]
