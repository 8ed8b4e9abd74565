"""Elements, assembly and condensation: by MKL (`pardiso`), or without it (`dissection`)."""
