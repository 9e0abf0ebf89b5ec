"""How two recordings differ: inputs, calls, samples."""
