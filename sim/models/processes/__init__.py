"""Fingers in other processes: what they are made from, processes that press them, many presses by one call."""
