"""A finger on its whole mesh, not condensed: strain maps (`strain_map`) and CalculiX decks (`deck`)."""
