"""Bands of decoded profiles: which share of the pressures they hold, over presses drawn at random."""
