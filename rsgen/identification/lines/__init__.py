"""Laws from periodic multisines: weighted least squares of the balance of forces at every line."""
