"""How right the model, the solvers, the statistics and the predictions are."""
