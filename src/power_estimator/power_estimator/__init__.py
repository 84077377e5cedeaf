"""Power models: the Power Prediction Network, proxies, named effects, and the live estimate."""
