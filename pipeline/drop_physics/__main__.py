"""`python -m drop_physics`: the command `drop`."""

import sys

if not sys.flags.safe_path and not __file__.startswith(sys.path[0]):
    del sys.path[0]  # the working directory, which holds data: none of it is imported

from drop_physics.console.running import main

main()
