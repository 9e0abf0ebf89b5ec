"""The recording: its schema, how it is written, how it is read back, how the viewer shows it."""

import os

# Rerun's library logs to standard error. What it has to say of a failure comes as an exception too,
# which becomes our one line; it reads this when it is first imported.
os.environ.setdefault("RUST_LOG", "error")
