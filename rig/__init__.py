"""Indentation rig controller: protocols, engine, drivers, data and reports."""
