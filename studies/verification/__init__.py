"""Problems with known answers, for the tests in tests/sim/oracles and for studies/accuracy/oracles.py."""
