"""Runs against the model: responses at the receptors, figures and reports."""
