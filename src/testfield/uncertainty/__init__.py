"""How well the results are known: propagation in closed form, and Monte Carlo that tests it."""
