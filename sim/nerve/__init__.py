"""Spikes of SA-I, RA and PC afferents from the strain that an indentor makes at their receptors."""
