"""The part of `drop record` that runs in a MuJoCo script's own interpreter, and watches its steps.

It needs Python 3.9 or later, numpy, and the script's own mujoco (3.3 or later). Functions of mujoco
are replaced by ones that call them (`hooks`); what the script writes without a call is found by
comparing memory (`memory`, `followed`). No number is touched.
"""
