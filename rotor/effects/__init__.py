"""The effect library: what a real rig may have and the nominal rotor does not have.

================  ==========================================================
module            what it holds
================  ==========================================================
``effect``        what an effect is: parameters, places, what it may add
``structure``     masses, shaft, disks, cracks
``supports``      bearings and what they stand on
``nonlinear``     local force laws at the bearings, at a node or in joints
``chain``         sensors, exciter, raster and sweep
``spinning``      gyroscopic moments and unbalance
``scale``         a rig's own units, in which ranges of numbers are stated
``library``       all of them by id
================  ==========================================================

A new effect is one class in one of these modules, and is then here as well; docs/new-effect.md says what else it takes.
"""

from __future__ import annotations

from rigtwin.rotor.effects.chain import *
from rigtwin.rotor.effects.effect import Effect as Effect
from rigtwin.rotor.effects.effect import Parameter as Parameter
from rigtwin.rotor.effects.effect import Place as Place
from rigtwin.rotor.effects.library import EFFECTS as EFFECTS
from rigtwin.rotor.effects.nonlinear import *
from rigtwin.rotor.effects.spinning import *
from rigtwin.rotor.effects.structure import *
from rigtwin.rotor.effects.supports import *
