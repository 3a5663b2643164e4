"""Tensor-product B-splines with one to three parameters; nothing geometric.

`BSpline` evaluates, refines and bounds; `ilattice.bspline.fit` makes one from samples.
"""

from ilattice.bspline.spline import BSpline

__all__ = ["BSpline"]
