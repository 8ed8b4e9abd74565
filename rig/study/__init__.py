"""Parameter studies: the same presses on many fingers, over processes or a cluster."""
