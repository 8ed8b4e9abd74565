"""Requests and stops to the process that owns the ports, over its private socket."""
