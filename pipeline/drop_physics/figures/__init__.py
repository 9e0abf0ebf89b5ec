"""Plots and videos, made from curves and images alone.

`plot` defines a plot's contents, `panel_plot` draws plots, and `animation` writes videos. Only
modules that draw plots load matplotlib.
"""
