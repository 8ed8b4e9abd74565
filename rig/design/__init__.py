"""Presses that distinguish candidate measures: expected information, choice, expected confusion."""
