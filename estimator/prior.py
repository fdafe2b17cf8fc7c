"""Which rigs the estimator is trained for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from rigtwin.rotor.frequency.modal import elastic_frequencies_hz
from rigtwin.rotor.model.condition import Condition
from rigtwin.rotor.model.rotor_model import build_system
from rigtwin.rotor.model.structure import Structure


@dataclass(frozen=True)
class Rigs:
    """A set of rigs to be measured; every array is (n,)."""

    k_b: np.ndarray  # [N/m]
    shaft_damping_ratio: np.ndarray  # [-]
    bearing_damping: np.ndarray  # [N s/m]

    def __len__(self) -> int:
        return len(self.k_b)


@dataclass(frozen=True)
class Prior:
    """Ranges: stiffness and shaft damping even in their logarithms, bearing damping even as it is: what it does to the
    three numbers grows with it. A share of the rigs has bearings without damping.

    Training goes a little beyond the range the estimator answers for, so that the ends of that
    range are interpolated.
    """

    k_b: tuple[float, float] = (1e6, 1e8)  # answered for [N/m]
    k_b_trained: tuple[float, float] = (6e5, 1.7e8)
    shaft_damping_ratio: tuple[float, float] = (0.0005, 0.005)
    bearing_damping: tuple[float, float] = (0.0, 60.0)  # [N s/m]
    undamped_share: float = 0.2

    def draw(self, n: int, seed: int, *, k_b: tuple[float, float] | None = None) -> Rigs:
        """Draw n rigs from a scrambled Sobol sequence.

        Parameters
        ----------
        n : number of rigs
        seed : of the scrambling
        k_b : range of k_b [N/m], default the trained one

        >>> rigs = PRIOR.draw(8, seed=1, k_b=(1e6, 1e8))
        >>> len(rigs), bool(((rigs.k_b >= 1e6) & (rigs.k_b <= 1e8)).all())
        (8, True)
        """
        u = qmc.Sobol(4, rng=np.random.default_rng(seed)).random_base2(int(np.ceil(np.log2(n))))[:n]
        damped = u[:, 3] >= self.undamped_share
        return Rigs(
            k_b=_log_uniform(u[:, 0], k_b or self.k_b_trained),
            shaft_damping_ratio=_log_uniform(u[:, 1], self.shaft_damping_ratio),
            bearing_damping=np.where(damped, np.interp(u[:, 2], (0.0, 1.0), self.bearing_damping), 0.0),
        )


def _log_uniform(u: np.ndarray, limits: tuple[float, float]) -> np.ndarray:
    low, high = np.log(limits)
    return np.exp(low + u * (high - low))


PRIOR = Prior()


# What PRIOR was chosen for: bearings of about this stiffness [N/m], and mode 2 on rigid supports [Hz].
_PRIOR_K_B, _PRIOR_F2 = 1e7, 324.0


def prior_for(structure: Structure, k_b: float, limits: tuple[float, float] = (0.0, np.inf)) -> Prior:
    """PRIOR carried over to another rotor with bearings of about this stiffness [N/m], and never beyond these limits.

    k_b spans the same factors as far as its limits let it, the bearings' loss factor c omega_2 / k_b the same range.
    """
    f2 = elastic_frequencies_hz(build_system(structure, Condition(rigid_support=True)), plane=1)[1]
    stiffer = k_b / _PRIOR_K_B
    more_damped = stiffer * _PRIOR_F2 / float(f2)
    return replace(
        PRIOR,
        k_b=_within(_scaled(PRIOR.k_b, stiffer), limits),
        k_b_trained=_within(_scaled(PRIOR.k_b_trained, stiffer), limits),
        bearing_damping=_scaled(PRIOR.bearing_damping, more_damped),
    )


def _scaled(limits: tuple[float, float], factor: float) -> tuple[float, float]:
    low, high = limits
    return factor * low, factor * high


def _within(span: tuple[float, float], limits: tuple[float, float]) -> tuple[float, float]:
    return max(span[0], limits[0]), min(span[1], limits[1])
