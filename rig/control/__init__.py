"""Ask and stop the process that owns the ports, over its private socket."""
