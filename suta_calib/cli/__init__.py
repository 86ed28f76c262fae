"""The command line: parse, call, print. No mathematics here."""

from suta_calib.cli._main import main as main
