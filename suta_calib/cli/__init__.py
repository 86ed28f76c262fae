"""The command line: parse, call, print. No mathematics here."""

from suta_calib.cli._app import main, run

__all__ = ["main", "run"]
