"""A bench supply that is polled for voltage and current over SCPI, and its energy balance."""
