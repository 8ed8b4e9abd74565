"""What was recorded: rates, spike times, and synthetic ones that say so in their name."""
