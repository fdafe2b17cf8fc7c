"""The rig TOML: a lateral beam with disks, lumped masses and supports, checked key by key."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from importlib.resources import files
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from rigtwin.parsing import parse_toml
from rigtwin.rotor.model.condition import MOST_BEARING_DAMPING
from rigtwin.rotor.model.elements import Cone, Section, cowper_shear_factor, round_section

# No rotor has numbers beyond these in whatever units, and products of a few of them are still numbers.
_LEAST, _MOST = 1e-30, 1e30


def _usual(value: float) -> float:
    if value and not _LEAST <= value <= _MOST:
        raise ValueError(f"is {value:g}; give a number from {_LEAST:g} to {_MOST:g}")
    return value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False), AfterValidator(_usual)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False), AfterValidator(_usual)]

# A shaft with a bending frequency [Hz] outside has a number in a wrong unit. An almost weightless one, whose masses are
# lumped elsewhere, is allowed.
_LOWEST_HZ, _HIGHEST_HZ = 1e-9, 1e15

# Two positions closer than this are the same place on the shaft.
SAME_PLACE_M = 1e-9


class RigError(ValueError):
    """The rig file cannot be used; the message names the file and the key."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


logger = logging.getLogger(__name__)

# The keys that make a segment a cone.
_CONICAL = ("diameter_left_m", "diameter_right_m", "bore_left_m", "bore_right_m")


class Segment(_Table):
    """A stretch of shaft, round (``diameter_m``), conical or of any doubly symmetric section.

    A cone gives ``diameter_left_m`` and ``diameter_right_m``, and for a conical bore ``bore_left_m`` and
    ``bore_right_m``; in between both follow straight lines.

    A general section gives ``area_m2``, ``second_moment_y_m4`` (bending in y, that is about the
    z axis), ``second_moment_z_m4`` (default: the same) and ``shear_factor`` (default: a solid circle's).
    """

    length_m: Positive
    youngs_modulus_Pa: Positive
    density_kg_per_m3: Positive
    poisson: Annotated[float, Field(ge=0, lt=0.5)] = 0.3
    diameter_m: Positive | None = None
    bore_m: NonNegative = 0.0
    diameter_left_m: Positive | None = None
    diameter_right_m: Positive | None = None
    bore_left_m: NonNegative | None = None
    bore_right_m: NonNegative | None = None
    area_m2: Positive | None = None
    second_moment_y_m4: Positive | None = None
    second_moment_z_m4: Positive | None = None
    shear_factor: Positive | None = None

    @model_validator(mode="after")
    def _one_kind_of_section(self) -> Segment:
        if self._is_conical:
            self._check_cone()
            return self
        if self.diameter_m is None and None in (self.area_m2, self.second_moment_y_m4):
            raise ValueError(
                "give diameter_m, or both of area_m2 and second_moment_y_m4, or for a cone both of diameter_left_m and "
                "diameter_right_m"
            )
        if self.diameter_m is not None and (self.area_m2 or self.second_moment_y_m4 or self.second_moment_z_m4):
            raise ValueError("give diameter_m or area_m2 with second_moment_y_m4, not both")
        if self.diameter_m is None and self.bore_m:
            raise ValueError("bore_m goes with diameter_m; area_m2 and second_moment_y_m4 already leave the bore out")
        if self.diameter_m is not None and self.bore_m >= self.diameter_m:
            raise ValueError("bore_m must be smaller than diameter_m")
        return self

    @property
    def _is_conical(self) -> bool:
        return any(getattr(self, key) is not None for key in _CONICAL)

    def _check_cone(self) -> None:
        """Both ends are given, each with a wall, and nothing of another section."""
        others = ("diameter_m", "area_m2", "second_moment_y_m4", "second_moment_z_m4")
        for key in (key for key in others if getattr(self, key) is not None):
            raise ValueError(f"{key} does not go with a cone; leave it out, or give both ends the same diameter")
        if self.diameter_left_m is None or self.diameter_right_m is None:
            raise ValueError("a cone needs both of diameter_left_m and diameter_right_m")
        if (self.bore_left_m is None) != (self.bore_right_m is None):
            raise ValueError("a conical bore needs both of bore_left_m and bore_right_m; a straight one has bore_m")
        if self.bore_left_m is not None and self.bore_m:
            raise ValueError("give bore_m, or both of bore_left_m and bore_right_m")
        for end, diameter, bore in zip(("left", "right"), *self._ends, strict=True):
            if bore >= diameter:
                raise ValueError(f"the bore must be smaller than diameter_{end}_m at the {end} end")

    @property
    def _ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Diameters and bores of a round segment, each left and right [m]."""
        left, right = (end or self.diameter_m or 0.0 for end in (self.diameter_left_m, self.diameter_right_m))
        bores = (self.bore_m if end is None else end for end in (self.bore_left_m, self.bore_right_m))
        return (left, right), tuple(bores)  # type: ignore[return-value]

    @property
    def cone(self) -> Cone | None:
        """The cone; None of a segment that is none."""
        if not self._is_conical:
            return None
        return Cone(*self._ends, self.density_kg_per_m3, self.youngs_modulus_Pa, self.poisson, self.shear_factor)

    @property
    def outline(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Outer diameters and bores at the left and the right end [m]; another section has those of its circle."""
        if self.area_m2 is not None:
            diameter = math.sqrt(4 * self.area_m2 / math.pi)
            return (diameter, diameter), (0.0, 0.0)
        return self._ends

    def sections(self) -> tuple[Section, Section]:
        """The section as the y plane and the z plane see it; of a cone that in the middle."""
        density, E, nu = self.density_kg_per_m3, self.youngs_modulus_Pa, self.poisson
        if self.cone:
            middle = self.cone.at(0.5)
            return middle, middle
        if self.diameter_m is not None:
            section = round_section(self.diameter_m, self.bore_m, density, E, nu, self.shear_factor)
            return section, section
        assert self.area_m2 and self.second_moment_y_m4
        kappa = self.shear_factor or cowper_shear_factor(nu, 0.0)
        second_z = self.second_moment_z_m4 or self.second_moment_y_m4
        return tuple(
            Section(self.area_m2, second, density, E, E / (2 * (1 + nu)), kappa)
            for second in (self.second_moment_y_m4, second_z)
        )  # type: ignore[return-value]


class Disk(_Table):
    """A rigid disk: by its dimensions, or by mass and moments of inertia.

    ``inertia = false`` (default) lumps the mass only, as the paper does.
    """

    node: Annotated[int, Field(ge=1)]
    diameter_m: Positive | None = None
    thickness_m: Positive | None = None
    bore_m: NonNegative = 0.0
    density_kg_per_m3: Positive | None = None
    mass_kg: Positive | None = None
    diametral_inertia_kg_m2: NonNegative | None = None
    polar_inertia_kg_m2: NonNegative | None = None
    inertia: bool = False

    @model_validator(mode="after")
    def _one_kind_of_disk(self) -> Disk:
        dimensions = (self.diameter_m, self.thickness_m, self.density_kg_per_m3)
        if self.mass_kg is None and None in dimensions:
            raise ValueError("give mass_kg, or all of diameter_m, thickness_m and density_kg_per_m3")
        if self.mass_kg is not None and (any(dimensions) or self.bore_m):
            raise ValueError("give mass_kg or the dimensions, not both")
        if self.mass_kg is None and (self.diametral_inertia_kg_m2, self.polar_inertia_kg_m2) != (None, None):
            raise ValueError("diametral_inertia_kg_m2 and polar_inertia_kg_m2 go with mass_kg, not with the dimensions")
        if self.mass_kg is not None and self.inertia and self.diametral_inertia_kg_m2 is None:
            raise ValueError("inertia = true needs diametral_inertia_kg_m2 beside mass_kg")
        if self.diameter_m is not None and self.bore_m >= self.diameter_m:
            raise ValueError("bore_m must be smaller than diameter_m")
        return self

    @property
    def mass(self) -> float:
        """Mass [kg]: rho pi (D^2 - d^2) t / 4."""
        if self.mass_kg is not None:
            return self.mass_kg
        assert self.diameter_m and self.thickness_m and self.density_kg_per_m3
        return self.density_kg_per_m3 * math.pi * (self.diameter_m**2 - self.bore_m**2) / 4 * self.thickness_m

    @property
    def own_diametral_inertia(self) -> float:
        """I_d [kg m^2] = m [3 (D^2 + d^2)/4 + t^2] / 12, or as given; zero where nothing is known."""
        if self.mass_kg is not None:
            return self.diametral_inertia_kg_m2 or 0.0
        assert self.diameter_m and self.thickness_m
        return self.mass * (3 * (self.diameter_m**2 + self.bore_m**2) / 4 + self.thickness_m**2) / 12

    @property
    def own_polar_inertia(self) -> float:
        """I_p [kg m^2] = m (D^2 + d^2)/8, or as given; by default twice I_d."""
        if self.mass_kg is not None:
            polar = self.polar_inertia_kg_m2
            return polar if polar is not None else 2 * self.own_diametral_inertia
        assert self.diameter_m
        return self.mass * (self.diameter_m**2 + self.bore_m**2) / 8

    @property
    def diametral_inertia(self) -> float:
        """I_d in the model [kg m^2]: zero without ``inertia``."""
        return self.own_diametral_inertia if self.inertia else 0.0

    @property
    def polar_inertia(self) -> float:
        """I_p in the model [kg m^2]: zero without ``inertia``."""
        return self.own_polar_inertia if self.inertia else 0.0


class Mass(_Table):
    """A lumped mass without rotary inertia."""

    node: Annotated[int, Field(ge=1)]
    mass_kg: Positive


_Coefficients = list[Annotated[float, Field(allow_inf_nan=False, ge=-_MOST, le=_MOST)]]


class SpeedCoefficients(_Table):
    """Stiffness [N/m] and damping [N s/m] of a support at some spin speeds [rev/min], as programs for fluid-film
    bearings list them: k_yz is the force in -y for a displacement in z. Coefficients that are left out are zero.
    """

    spin_rpm: Annotated[list[NonNegative], Field(min_length=2)]
    kyy_N_per_m: _Coefficients
    kyz_N_per_m: _Coefficients = []
    kzy_N_per_m: _Coefficients = []
    kzz_N_per_m: _Coefficients
    cyy_Ns_per_m: _Coefficients
    cyz_Ns_per_m: _Coefficients = []
    czy_Ns_per_m: _Coefficients = []
    czz_Ns_per_m: _Coefficients

    @model_validator(mode="after")
    def _one_value_for_each_speed(self) -> SpeedCoefficients:
        if any(b <= a for a, b in pairwise(self.spin_rpm)):
            raise ValueError("spin_rpm must increase")
        n = len(self.spin_rpm)
        for name in SpeedCoefficients.model_fields:
            if (given := len(getattr(self, name))) not in ((n,) if name in self.model_fields_set else (0, n)):
                raise ValueError(f"{name} has {given} values, and spin_rpm has {n}: give one for each speed")
        return self

    def matrices(self, letter: Literal["k", "c"]) -> list[list[list[float]]]:
        """(n_speeds, 2, 2) in (y, z): stiffness "k" [N/m] or damping "c" [N s/m]."""
        unit = {"k": "N_per_m", "c": "Ns_per_m"}[letter]
        none = [0.0] * len(self.spin_rpm)
        columns = [getattr(self, f"{letter}{pair}_{unit}") or none for pair in ("yy", "yz", "zy", "zz")]
        return [[[yy, yz], [zy, zz]] for yy, yz, zy, zz in zip(*columns, strict=True)]


class SupportTable(_Table):
    """A support: ``stiffness`` [N/m] is a number, "k_b" (a bearing), "rigid" or "table"; tilt is a number or "rigid".

    With "table", ``table`` holds stiffness and damping over the spin speed.
    """

    node: Annotated[int, Field(ge=1)]
    stiffness: Literal["k_b", "rigid", "table"] | NonNegative
    tilt_stiffness_Nm_per_rad: Literal["rigid"] | NonNegative = 0.0
    damping_Ns_per_m: NonNegative = 0.0
    table: SpeedCoefficients | None = None

    @model_validator(mode="after")
    def _has_the_table_that_it_names(self) -> SupportTable:
        if (self.stiffness == "table") != (self.table is not None):
            raise ValueError('stiffness = "table" and a [support.table] go together: give both, or neither')
        if self.table and self.damping_Ns_per_m:
            raise ValueError("damping_Ns_per_m goes with a stiffness that is a number; a table has its own damping")
        return self

    @model_validator(mode="after")
    def _bearing_damper_is_a_parameter(self) -> SupportTable:
        if self.stiffness == "k_b" and self.damping_Ns_per_m:
            raise ValueError('a "k_b" support takes its damping from bearing_damping_Ns_per_m at the top level')
        return self


class Joint(_Table):
    """A joint between two sections of the shaft, such as a lap joint, a flange or a coupling half.

    It sits at a node or at a position ``x_m``. Springs and dashpots connect the two sections: one across the shaft
    [N/m, N s/m] and one against their angle [N m/rad, N m s/rad], the same in both planes. What is "rigid" gives no
    way. A node at the joint belongs to the section on its left.
    """

    node: Annotated[int, Field(ge=1)] | None = None
    x_m: Positive | None = None
    stiffness_N_per_m: Literal["rigid"] | Positive = "rigid"
    tilt_stiffness_Nm_per_rad: Literal["rigid"] | Positive = "rigid"
    damping_Ns_per_m: NonNegative = 0.0
    tilt_damping_Nms_per_rad: NonNegative = 0.0

    @model_validator(mode="after")
    def _at_one_place_and_soft(self) -> Joint:
        if (self.node is None) == (self.x_m is None):
            raise ValueError("give node or x_m, one of the two")
        if self.stiffness_N_per_m == self.tilt_stiffness_Nm_per_rad == "rigid":
            raise ValueError("gives no way at all: give stiffness_N_per_m or tilt_stiffness_Nm_per_rad a number")
        if self.stiffness_N_per_m == "rigid" and self.damping_Ns_per_m:
            raise ValueError("damping_Ns_per_m does nothing beside a rigid stiffness_N_per_m: remove it, or give both")
        if self.tilt_stiffness_Nm_per_rad == "rigid" and self.tilt_damping_Nms_per_rad:
            raise ValueError(
                "tilt_damping_Nms_per_rad does nothing beside a rigid tilt_stiffness_Nm_per_rad: remove it, "
                "or give both"
            )
        return self


class BearingStiffness(_Table):
    """Start value and range of the parameter k_b."""

    start_N_per_m: Positive = 1e7
    min_N_per_m: Positive = 1e4
    max_N_per_m: Positive = 1e12

    @model_validator(mode="after")
    def _ordered(self) -> BearingStiffness:
        if not self.min_N_per_m <= self.start_N_per_m <= self.max_N_per_m:
            raise ValueError("need min_N_per_m <= start_N_per_m <= max_N_per_m")
        return self

    def limit(self, low: float, high: float) -> tuple[float, float]:
        """A range of k_b [N/m] that ends where this one does; an end that is the format's default says nothing.

        >>> BearingStiffness(max_N_per_m=2e7).limit(1.0, 1e14)
        (1.0, 20000000.0)
        """
        unsaid = {name: field.default for name, field in type(self).model_fields.items()}
        return (
            low if self.min_N_per_m == unsaid["min_N_per_m"] else self.min_N_per_m,
            high if self.max_N_per_m == unsaid["max_N_per_m"] else self.max_N_per_m,
        )


class Rig(_Table):
    """A rig as written in its TOML file; lengths in m, nodes counted from 1."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
    title: str = ""
    nodes_m: Annotated[list[NonNegative], Field(min_length=2)]
    elements_between_nodes: Annotated[int, Field(ge=1, le=64)] = 1
    shaft_damping_ratio: Annotated[float, Field(ge=0, le=0.2)] = 0.001
    bearing_damping_Ns_per_m: Annotated[float, Field(ge=0, le=MOST_BEARING_DAMPING)] = 0.0
    excitation_node: Annotated[int, Field(ge=1)] = 2
    k_b: BearingStiffness = BearingStiffness()
    segment: Annotated[list[Segment], Field(min_length=1)]
    disk: list[Disk] = []
    mass: list[Mass] = []
    support: Annotated[list[SupportTable], Field(min_length=1)]
    joint: list[Joint] = []

    @model_validator(mode="after")
    def _consistent(self) -> Rig:
        x = self.nodes_m
        if any(b - a <= SAME_PLACE_M for a, b in pairwise(x)):
            raise ValueError("nodes_m must increase")
        if abs(x[0]) > SAME_PLACE_M or abs(x[-1] - self.length) > SAME_PLACE_M:
            raise ValueError(
                f"nodes_m must run from 0 to the shaft's end at {self.length:g} m (sum of segment lengths); "
                f"it runs from {x[0]:g} to {x[-1]:g}"
            )
        for kind in ("disk", "mass", "support"):
            for place, item in enumerate(getattr(self, kind), start=1):
                if item.node > len(x):
                    raise ValueError(f"{kind} {place}: node {item.node} does not exist, the rig has {len(x)} nodes")
        for place, segment in enumerate(self.segment, start=1):
            if not _LOWEST_HZ < (f := _bending_frequency_hz(segment, self.length)) < _HIGHEST_HZ:
                raise ValueError(
                    f"segment {place}: a shaft of it would bend at about {f:.0e} Hz; lengths are in m, moduli in Pa "
                    "and densities in kg/m^3"
                )
        if self.excitation_node > len(x):
            raise ValueError(f"excitation_node {self.excitation_node} does not exist, the rig has {len(x)} nodes")
        if len({s.node for s in self.support}) < len(self.support):
            raise ValueError("two supports at one node: merge them")
        if not any(s.stiffness in ("k_b", "table") for s in self.support):
            raise ValueError('no support has stiffness = "k_b": there is no bearing to identify')
        self._check_joints()
        self._check_tables()
        return self

    def _check_joints(self) -> None:
        """Joints lie between the shaft's ends, one at a place."""
        for place, joint in enumerate(self.joint, start=1):
            if joint.node is not None and joint.node > len(self.nodes_m):
                raise ValueError(
                    f"joint {place}: node {joint.node} does not exist, the rig has {len(self.nodes_m)} nodes"
                )
        places = self.joints_m
        for place, x in enumerate(places, start=1):
            if not SAME_PLACE_M < x < self.length - SAME_PLACE_M:
                raise ValueError(
                    f"joint {place}: lies at {x:g} m, and the shaft runs from 0 to {self.length:g} m; a joint has a "
                    "section on both sides"
                )
            if any(abs(x - other) <= SAME_PLACE_M for other in places[: place - 1]):
                raise ValueError(f"joint {place}: there is another joint at {x:g} m; merge them")

    def _check_tables(self) -> None:
        """There is a spin speed that all tables of supports hold."""
        tables = [(s.node, s.table.spin_rpm[0], s.table.spin_rpm[-1]) for s in self.support if s.table]
        for node, low, high in tables:
            if any(low > other or least > high for _, least, other in tables):
                raise ValueError(
                    f"the table of the support at node {node} runs from {low:g} to {high:g} rev/min, and another one "
                    "has none of these speeds: the rotor could never spin"
                )

    @property
    def has_tables(self) -> bool:
        """Whether supports follow the spin speed."""
        return any(s.table for s in self.support)

    @property
    def has_bearings(self) -> bool:
        """Whether a support has the stiffness k_b."""
        return any(s.stiffness == "k_b" for s in self.support)

    @property
    def joints_m(self) -> list[float]:
        """Positions of the joints along the shaft [m]."""
        return [self.nodes_m[j.node - 1] if j.node is not None else float(j.x_m or 0.0) for j in self.joint]

    @property
    def length(self) -> float:
        """Length of the shaft [m]."""
        return sum(s.length_m for s in self.segment)

    def _repr_html_(self) -> str:
        """Drawing and dimensions, for notebooks."""
        from rigtwin.rotor.geometry.drawing import rig_svg
        from rigtwin.rotor.model.html import facts

        counted = {"disks": self.disk, "lumped masses": self.mass, "supports": self.support, "joints": self.joint}
        drawn = rig_svg(self)  # pyright: ignore[reportArgumentType] - one class, seen under two paths
        return drawn + facts(
            [
                ("rig", f"{self.name}: {self.title}" if self.title else self.name),
                ("shaft", f"{self.length:g} m, {len(self.nodes_m)} nodes"),
                *((what, len(there)) for what, there in counted.items() if there),
                ("force at node", self.excitation_node),
                ("k_b", f"{self.k_b.start_N_per_m:g} N/m to begin with"),
                (
                    "damping",
                    f"shaft {100 * self.shaft_damping_ratio:g} %, bearings {self.bearing_damping_Ns_per_m:g} N s/m",
                ),
            ]
        )

    def same_rotor(self, other: Rig) -> bool:
        """Whether shaft, disks, masses and supports are the same; titles, meshes and start values may differ."""
        parts = {"nodes_m", "segment", "disk", "mass", "support", "joint"}
        return self.model_dump(include=parts) == other.model_dump(include=parts)


def _bending_frequency_hz(segment: Segment, length: float) -> float:
    """First of a uniform shaft on two pins, after Euler and Bernoulli: pi/2 sqrt(E I / (rho A L^4)), in y."""
    section = segment.sections()[0]
    stiffness, mass = section.youngs_modulus * section.second_moment, section.density * section.area
    return math.pi / 2 * math.sqrt(stiffness / mass) / length**2 if mass else math.inf


def shipped_rigs() -> list[str]:
    """Names of the rigs that come with rigtwin."""
    return sorted(
        p.name.removesuffix(".toml")
        for p in files("rigtwin.rotor").joinpath("rigs").iterdir()
        if p.name.endswith(".toml")
    )


def load_rig(source: str | Path) -> Rig:
    """Load a shipped rig by name, or a rig TOML by path.

    Raises
    ------
    RigError : no such rig or file, not TOML, a key is wrong (every wrong key is named), or another rotor has the
        name of a shipped one

    >>> load_rig("nit-rourkela").length
    0.426
    """
    if str(source) in shipped_rigs():
        return parse_rig(
            files("rigtwin.rotor").joinpath("rigs", f"{source}.toml").read_text(encoding="utf-8"), f"rig {source}"
        )
    try:
        rig = parse_rig(Path(source).read_text(encoding="utf-8-sig"), str(source))
    except (OSError, UnicodeDecodeError) as error:
        known, why = shipped_rigs(), error.strerror if isinstance(error, OSError) else error
        hint = "".join(f"did you mean {name}? " for name in get_close_matches(str(source), known, n=1))
        said = f"{hint}give a rig TOML or one of: {', '.join(known)}"
        raise RigError(f"{source}: cannot be read ({why}); {said}") from error
    if rig.name in shipped_rigs() and not rig.same_rotor(load_rig(rig.name)):
        raise RigError(f"{source}: name: {rig.name} is a shipped rig of other dimensions; give this one another name")
    for words in _implausible(rig):
        _say_once(f"{source}: {words}")
    return rig


# Modulus of the softest shaft [Pa]: less is most likely written in another unit, such as GPa or N/mm^2. Densities that
# are most likely written in g/cm^3; a shaft without mass has less.
_SOFTEST, _IN_GRAMS = 1e8, (0.5, 30.0)


@cache
def _say_once(words: str) -> None:
    """A command loads a rig several times."""
    logger.warning(words)


def _implausible(rig: Rig) -> Iterator[str]:
    """A sentence on each dimension that no rotor has, most often because it is in another unit."""
    parts = {"segment": rig.segment, "disk": rig.disk}
    for kind, limit in (("segment", 1.0), ("disk", 20.0)):
        for number, part in enumerate(parts[kind], start=1):
            if part.diameter_m and part.diameter_m > limit * rig.length:
                yield (
                    f"{kind} {number}: diameter_m = {part.diameter_m:g} is much for a shaft of {rig.length:g} m; "
                    "lengths are in metres"
                )
    for number, segment in enumerate(rig.segment, start=1):
        if segment.youngs_modulus_Pa < _SOFTEST:
            yield f"segment {number}: youngs_modulus_Pa = {segment.youngs_modulus_Pa:g} is little; steel has 2.1e11 Pa"
    for kind, each in parts.items():
        for number, part in enumerate(each, start=1):
            if part.density_kg_per_m3 and _IN_GRAMS[0] <= part.density_kg_per_m3 <= _IN_GRAMS[1]:
                yield f"{kind} {number}: density_kg_per_m3 = {part.density_kg_per_m3:g} is little; steel has 7850 kg/m³"


def parse_rig(text: str, where: str = "rig") -> Rig:
    """Parse the text of a rig TOML; ``where`` names it in error messages. Raises RigError."""
    try:
        table = parse_toml(text)
    except ValueError as error:
        raise RigError(f"{where}: {error}") from error
    try:
        return Rig.model_validate(table)
    except ValidationError as error:
        raise RigError(f"{where}: " + "; ".join(_problems(error))) from error


def _problems(error: ValidationError) -> list[str]:
    """One sentence for each wrong key; a key with alternatives lists what each would take."""
    messages: dict[str, list[str]] = {}
    for problem in error.errors():
        messages.setdefault(_key(problem["loc"]), []).append(_in_words(problem["type"], problem["msg"], problem["loc"]))
    return [f"{key}: {', or: '.join(texts)}" for key, texts in messages.items()]


def _in_words(kind: str, message: str, location: tuple[int | str, ...]) -> str:
    if kind == "extra_forbidden":
        known = [
            key
            for table in (Rig, Segment, Disk, Mass, SupportTable, SpeedCoefficients, Joint, BearingStiffness)
            for key in table.model_fields
        ]
        close = get_close_matches(str(location[-1]), known, n=1)
        return f"unknown key; did you mean {close[0]}?" if close else "unknown key; check its spelling or remove it"
    if kind == "string_pattern_mismatch":
        return "without blanks: write letters, digits, '.', '_' and '-', beginning with a letter or a digit"
    return "is missing; write it" if kind == "missing" else message.removeprefix("Value error, ")


def _key(location: tuple[int | str, ...]) -> str:
    """'segment 1, poisson' for ('segment', 0, 'poisson'); pydantic's union branches are left out."""
    words = [str(part + 1) if isinstance(part, int) else part for part in location]
    return " ".join(w for w in words if not w.startswith(("function-", "literal", "constrained"))) or "rig"
