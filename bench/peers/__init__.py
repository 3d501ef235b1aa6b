"""Other estimators of a load, and palpate, on the same recordings of the simulated arm."""
