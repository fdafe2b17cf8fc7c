"""A run's magnitudes beside those that the drawing gives, with the bearings as stiff as suits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize_scalar

from rigtwin.gap.audit.checked_run import CheckedRun
from rigtwin.gap.audit.geometry import Geometry
from rigtwin.rotor.model.arrays import FloatArray

# Stiffnesses of bearings that are tried, and frequencies along the band at which a run's lines are looked at.
STIFFNESSES = 49
SPREAD = 200


class Curves:
    """How far a run's magnitudes are from the drawing's under some names.

    Parameters
    ----------
    places : (n,) live channels that move, along the exciter
    """

    def __init__(self, p: CheckedRun, places: Sequence[int], geometry: Geometry):
        # Evenly along the band: lines crowd at peaks, where a gap shows most.
        spread = np.clip(np.searchsorted(p.f, np.linspace(p.f[0], p.f[-1], SPREAD)), 0, len(p.f) - 1)
        run, f = p.run, p.f[spread]
        self._measured = np.log(np.abs(p.receptance[np.ix_(spread, places)]) + np.finfo(float).tiny)
        self._k_b = np.log(geometry.stiffnesses(STIFFNESSES if run.support != "rigid" else 1))

        @lru_cache(maxsize=len(self._k_b) * len(geometry.nodes))
        def drawn(ln_k_b: float, exciter: int) -> FloatArray:
            H = geometry.response(run, f, float(np.exp(ln_k_b)), exciter)
            return np.log(np.abs(H) + np.finfo(float).tiny)

        self._drawn = drawn

    def distance(self, nodes: Sequence[int], exciter: int) -> float:
        """Mean over channels of the median |ln ratio|, with one gain for all and the k_b that suits these names."""
        return self._nearest(lambda x: self._at(x, nodes, exciter))[0]

    def distance_and_gain(self, nodes: Sequence[int], exciter: int) -> tuple[float, float]:
        """``distance``, and the one gain."""
        distance, ln_k_b = self._nearest(lambda x: self._at(x, nodes, exciter))
        return distance, float(np.exp(np.median(np.median(self._ratio(ln_k_b, nodes, exciter), axis=0))))

    def _nearest(self, off: Callable[[float], float]) -> tuple[float, float]:
        """How little is off, and at which ln k_b."""
        raster = [off(x) for x in self._k_b]
        k = int(np.argmin(raster))
        if len(self._k_b) == 1:
            return raster[k], float(self._k_b[k])
        ends = self._k_b[max(k - 1, 0)], self._k_b[min(k + 1, len(self._k_b) - 1)]
        nearest = minimize_scalar(off, bounds=ends, method="bounded", options={"xatol": 1e-3})
        return min((raster[k], float(self._k_b[k])), (float(nearest.fun), float(nearest.x)))

    def rough_distance(self, nodes: Sequence[int], exciter: int) -> float:
        """``distance`` at the nearest k_b of a raster."""
        return min(self._at(x, nodes, exciter) for x in self._k_b)

    def with_own_sizes(self, nodes: Sequence[int], exciter: int) -> tuple[float, FloatArray]:
        """What each channel is off with a gain of its own, at the k_b that suits, and these beside the usual.

        Returns
        -------
        mean over channels of the median |ln ratio|, and (n,) logarithms of their gains over the median one
        """
        left, ln_k_b = self._nearest(lambda x: float(np.mean(self._off(x, nodes, exciter)[0])))
        sizes = self._off(ln_k_b, nodes, exciter)[1]
        return left, sizes - np.median(sizes)

    def _off(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> tuple[FloatArray, FloatArray]:
        """(n,) median |ln ratio| of every channel with a gain of its own, and (n,) logarithms of these gains."""
        ratio = self._ratio(ln_k_b, nodes, exciter)
        sizes = np.median(ratio, axis=0)
        return np.median(np.abs(ratio - sizes), axis=0), sizes

    def _ratio(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> FloatArray:
        return self._measured - self._drawn(ln_k_b, exciter)[:, np.array(nodes) - 1]

    def _at(self, ln_k_b: float, nodes: Sequence[int], exciter: int) -> float:
        ratio = self._ratio(ln_k_b, nodes, exciter)
        ratio -= np.median(np.median(ratio, axis=0))
        return float(np.mean(np.median(np.abs(ratio), axis=0)))
