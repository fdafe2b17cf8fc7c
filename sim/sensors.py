"""Noise of the virtual accelerometers."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from rigtwin.rotor.model.arrays import FloatArray


@dataclass(frozen=True)
class SensorNoise:
    """White noise of a sensor chain, repeatable from its seed.

    It is given as the standard error of a line's phasor, which is the root of the sum of the squares of
    ``relative`` times the line's magnitude and ``floor`` [m/s^2]. The samples get the noise that leads
    to this error. Repeated runs of one set-up differ by ``repeat``.
    """

    relative: float = 0.0
    floor: float = 0.0
    seed: int = 0
    repeat: int = 0

    def add(self, samples: FloatArray, stream: tuple[str | int | float, ...]) -> FloatArray:
        """Samples with noise; the same seed, repeat and stream give the same noise.

        Parameters
        ----------
        samples : (N, n_channels) [m/s^2]
        stream : values that identify this window among all others, for example (support, force, line)

        >>> samples, noise = np.zeros((4, 1)), SensorNoise(floor=0.1, seed=1)
        >>> bool((noise.add(samples, ("rigid", 50.0)) == noise.add(samples, ("rigid", 50.0))).all())
        True
        """
        if not (self.relative or self.floor):
            return samples
        key = hashlib.sha256(repr((int(self.seed), int(self.repeat), *stream)).encode()).digest()
        rng = np.random.default_rng(int.from_bytes(key, "big"))
        peak = np.sqrt(2) * samples.std(axis=0)
        line_error = np.hypot(self.relative * peak, self.floor)  # sqrt(E|error|^2) of the phasor
        return samples + rng.standard_normal(samples.shape) * line_error * np.sqrt(len(samples)) / 2
