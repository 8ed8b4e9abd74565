"""Every kind of device in the registry, on its virtual twin behind real ports."""
