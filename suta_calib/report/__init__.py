"""A solution shown: console, plots, HTML."""
