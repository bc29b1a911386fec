"""Resonance curves with folds and stability, from an identification or an oscillator."""

from __future__ import annotations

from rsgen.identification.prediction.prediction_result import HeldOutLevel, Prediction, ResonanceCurve
from rsgen.identification.prediction.resonance_curves import predict, predict_held_out, predict_records

__all__ = ["HeldOutLevel", "Prediction", "ResonanceCurve", "predict", "predict_held_out", "predict_records"]
