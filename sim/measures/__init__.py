"""Strain and stress measures at the receptors."""
