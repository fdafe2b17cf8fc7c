"""ONNX files in use; onnxruntime is imported when the first is opened."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

CARD_KEY = "rigtwin.card"


def onnx_session(model: Path) -> Any:
    """An ONNX file as an ``onnxruntime.InferenceSession``, to be run by one thread."""
    # onnxruntime reads this when it is imported, and else keeps a device id and a list of events in the user's cache,
    # and sends them. What the user has set stands.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    how = {"providers": ["CPUExecutionProvider"], "enable_fallback": False}  # which would print on stdout
    return onnxruntime.InferenceSession(str(model), options, **how)
