"""All effects by id, in the order of the documentation."""

from __future__ import annotations

from rotor.effects.chain import (
    CoarseGrid,
    FastSweep,
    ForceDropout,
    SensorDelay,
    SensorGain,
    SensorMass,
    SensorPosition,
)
from rotor.effects.effect import Effect
from rotor.effects.nonlinear import (
    BearingClearance,
    BearingCubic,
    BearingFriction,
    BearingHertz,
    BilinearSupport,
    Rub,
)
from rotor.effects.spinning import Gyroscopic, UnbalanceForce
from rotor.effects.structure import (
    AttachedMass,
    AxialLoad,
    DiskInertia,
    DiskMass,
    ExciterSuspension,
    HubStiffening,
    OpenCrack,
    ShaftDamping,
    ShaftModulus,
)
from rotor.effects.supports import (
    BearingAsymmetry,
    BearingDamping,
    BearingOffset,
    BearingTiltStiffness,
    CompliantRigidSupport,
    PedestalFlexibility,
    PlaneAnisotropy,
    ViscoelasticSupport,
)

# fmt: off
EFFECTS: dict[str, type[Effect]] = {effect.id: effect for effect in (
    AttachedMass, ExciterSuspension, DiskMass, DiskInertia, HubStiffening, ShaftModulus, AxialLoad, OpenCrack,
    ShaftDamping,
    BearingDamping, BearingTiltStiffness, PedestalFlexibility, BearingAsymmetry, BearingOffset,
    CompliantRigidSupport, PlaneAnisotropy, ViscoelasticSupport,
    BearingCubic, BearingHertz, BearingClearance, BearingFriction, BilinearSupport, Rub,
    SensorGain, SensorDelay, SensorMass, SensorPosition, ForceDropout, CoarseGrid, FastSweep,
    Gyroscopic, UnbalanceForce,
)}
# fmt: on
