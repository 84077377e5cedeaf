"""Walking policies on a robot under a safety supervisor."""
