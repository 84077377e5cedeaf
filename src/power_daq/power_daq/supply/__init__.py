"""A bench supply that is asked for voltage and current over SCPI, and the books kept on it."""
