"""Sessions: a script rehearsed, dry-run, run on real ports, or resumed."""
