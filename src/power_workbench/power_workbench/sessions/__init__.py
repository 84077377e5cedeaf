"""Sessions: steps, findings, views and the worker of each tab."""
