"""Problems with known answers, for the tests in tests/sim/oracles and for bench/oracles.py."""
