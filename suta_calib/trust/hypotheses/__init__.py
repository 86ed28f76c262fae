"""Ways in which data can be wrong: one module each, found by `hypothesis.known_hypotheses`."""
