"""Simulated measurements: any arm, any artefact, known truth."""
