"""Recordings: rates, spike times, and synthetic recordings, whose names say so."""
