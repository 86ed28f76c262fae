"""Which model of the arm predicts data it was not fitted to: what is worth estimating."""

from suta_calib.analysis.model_selection.selection import ModelSelection, choose_model
from suta_calib.trust.cross_validation import CrossValidation, ModelCandidate

__all__ = ["CrossValidation", "ModelCandidate", "ModelSelection", "choose_model"]
