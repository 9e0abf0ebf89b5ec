"""Plots and videos, made from curves and images alone.

`plot` holds a plot's contents, `panel_plot` draws it; `animation` writes films. Only modules that
draw plots load matplotlib.
"""
