"""The estimator in use: the ONNX file, numpy and onnxruntime, nothing else."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from rigtwin.estimator.onnx_file import CARD_KEY, onnx_session


@dataclass(frozen=True)
class Estimate:
    """Bearing stiffness with its interval [N/m]; not to be used where ``valid`` is false."""

    k_b: float
    k_b_std: float
    k_b_low: float
    k_b_high: float
    valid: bool


# The estimator's outputs, in this order in the network, the model card and the FMU.
OUTPUT_NAMES = tuple(field.name for field in fields(Estimate))


class StiffnessEstimator:
    """The trained network.

    Parameters
    ----------
    model : path of the ONNX file; default the one that comes with rigtwin
    """

    def __init__(self, model: Path | None = None):
        self._session = onnx_session(model or shipped_model())

    @property
    def card(self) -> dict[str, Any]:
        """Model card: what the network is for, its ranges, how it was made and how well it does."""
        return json.loads(self._session.get_modelmeta().custom_metadata_map[CARD_KEY])

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """Estimates of many tests at once.

        Parameters
        ----------
        features : (n, 6) delta_f1, delta_f2 [Hz], amplitude_ratio [-], and their standard errors

        Returns
        -------
        (n, 5) k_b, k_b_std, k_b_low, k_b_high [N/m], valid (0 or 1)
        """
        outputs = self._session.run(None, {"features": np.asarray(features, dtype=np.float32)})
        return np.asarray(outputs[0], dtype=float)

    def estimate(self, features: np.ndarray) -> Estimate:
        """Estimate of one test; features is (6,).

        >>> found = StiffnessEstimator().estimate(np.array([4.035, 25.996, 1.2, 0.01, 0.02, 0.01]))
        >>> found.valid, f"{found.k_b:.1e}"
        (True, '1.0e+07')
        """
        k, std, low, high, valid = self(np.asarray(features)[None, :])[0].tolist()
        return Estimate(k, std, low, high, valid > 0.5)


def shipped_model() -> Path:
    """Path of the trained network that comes with rigtwin."""
    return Path(__file__).with_name("model") / "stiffness.onnx"
