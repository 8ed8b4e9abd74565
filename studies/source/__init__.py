"""The facts, figures and tables of Raju (1998), as this finger has them."""
