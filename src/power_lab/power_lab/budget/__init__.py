"""Energy budgets: shares of effects in the metered power, and what would change them."""
