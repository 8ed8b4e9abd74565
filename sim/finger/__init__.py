"""Geometry and mesh of the fingertip.

`surface` is the skin, made of sections (`section`) that `fit` fits to points. A mesh (`mesh`) is nodes along and
around the finger (`grading`) times layers below the skin (`layers`); `skin` gives each node its area, `quality` says
how well shaped the elements are, `vtk` writes them for ParaView.
"""
