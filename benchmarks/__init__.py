"""How fast, how large: every promise of the project, measured beside what it is compared with.

    python -m benchmarks [--only NAME] [--quick]

One script per question. Each yields measurements; ratios are of runs in pairs, one after the other
in the same minute, because a machine's speed changes with what else it does.
"""
