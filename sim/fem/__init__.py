"""Elements, assembly and condensation: by MKL (`pardiso`), or slab by slab without it (`slabs`)."""
