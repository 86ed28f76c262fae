"""From an instrument's raw points on an artefact to landmarks with their uncertainty."""
