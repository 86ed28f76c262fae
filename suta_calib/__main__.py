"""``python -m suta_calib``."""

from suta_calib.cli import main

if __name__ == "__main__":
    main()
