"""Which model of the arm predicts data it was not fitted to: what is worth estimating."""

from suta_calib.analysis.model_selection.cross_validation import CrossValidation, ModelCandidate
from suta_calib.analysis.model_selection.selection import ModelSelection, choose_model

__all__ = ["CrossValidation", "ModelCandidate", "ModelSelection", "choose_model"]
