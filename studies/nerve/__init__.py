"""The three classes of `sim.nerve` beside 18 published tests of afferents."""
