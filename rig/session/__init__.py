"""A script carried out: rehearsed, on the virtual bench, on real ports, or taken up again."""
