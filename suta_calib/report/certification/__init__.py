"""A certified artefact, shown."""
