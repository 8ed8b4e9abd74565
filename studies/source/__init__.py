"""The facts of Raju 1998 (S.M. thesis, MIT) that the model can be asked about: `studies/results/source/facts.csv`."""
