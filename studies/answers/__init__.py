"""How far an answer can be trusted: afferents whose truth is known."""
