"""The recording: its schema, how it is written, how it is read back, how the viewer shows it."""

import os

# Rerun's library logs to standard error. It also raises failures as exceptions, which become our
# one line. It reads this variable when it is first imported.
os.environ.setdefault("RUST_LOG", "error")
