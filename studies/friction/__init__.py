"""Friction beside closed forms, beside CalculiX, and what it costs."""
