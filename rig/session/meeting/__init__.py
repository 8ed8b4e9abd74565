"""`rig meet`: the rig learns which finger lies under it, press by press, and writes what it learned."""
