"""Chooses the model of the arm that predicts left-out data best."""

from suta_calib.analysis.model_selection.selection import ModelSelection, choose_model
from suta_calib.trust.cross_validation import CrossValidation, ModelCandidate

__all__ = ["CrossValidation", "ModelCandidate", "ModelSelection", "choose_model"]
