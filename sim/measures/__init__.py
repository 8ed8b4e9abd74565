"""Receptors under the skin and the strain at them (`receptors`), and the 18 measures of it (`measures`)."""
