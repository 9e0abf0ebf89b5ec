"""Benchmarks of speed, size and memory: each of the project's goals, measured against a baseline.

    python -m benchmarks [--only NAME] [--quick]

One script per question. Each yields measurements. Ratios are of paired runs, one right after the
other, because a machine's speed varies with its load.
"""
