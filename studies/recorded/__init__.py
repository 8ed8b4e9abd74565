"""How far the verdict on a recorded afferent can be trusted."""
