"""`python cli.py …` from a checkout: the command `drop`, from the sources beside this file."""

import sys
from pathlib import Path

sys.path[0] = str(Path(__file__).parent / "pipeline")

from drop_physics.console.running import main  # noqa: E402 - after the path to it

if __name__ == "__main__":
    main()
