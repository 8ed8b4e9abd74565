"""Speed against error: scenes, what solves them, what that costs, and the reference that says how wrong it is."""
