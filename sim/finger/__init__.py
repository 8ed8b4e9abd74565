"""Geometry and mesh of the fingertip.

`surface` is the skin, fitted to measured points section by section. `mesh` puts nodes along and around the finger and
layers below the skin, with areas of the skin nodes and the quality of elements. `vtk` writes meshes for ParaView.
"""
