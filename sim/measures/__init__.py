"""Receptors under the skin, their strains (`receptors`), and the 18 measures of strain (`measures`)."""
