"""Which model of the arm predicts data it was not fitted to: what is worth estimating."""

from suta_calib.analysis.model_choice.choice import ModelChoice, choose_model

__all__ = ["ModelChoice", "choose_model"]
