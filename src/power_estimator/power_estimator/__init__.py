"""Power models of joint drives: the Power Prediction Network, proxies, models of named effects, and the live estimate."""
