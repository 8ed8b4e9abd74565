"""What a finger that stiffens comes to at finite strain, and how near the simulator's quick answer is."""
