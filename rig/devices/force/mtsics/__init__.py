"""A balance that speaks MT-SICS."""
