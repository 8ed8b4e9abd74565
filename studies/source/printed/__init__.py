"""What the source prints, figure by figure and table by table, each beside what the model gives."""
