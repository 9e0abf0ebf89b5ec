"""The recording: its schema, writing and reading it, and its layout in the viewer."""

import os

# Rerun's library logs to standard error. It also raises failures as exceptions, which become our
# one line. It reads this variable when it is first imported.
os.environ.setdefault("RUST_LOG", "error")
