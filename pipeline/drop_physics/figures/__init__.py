"""Plots and films for people, made from curves and pictures alone.

`plot` holds a plot's contents, `panel_plot` draws it; `animation` writes films. Only modules that
draw plots load matplotlib.
"""
