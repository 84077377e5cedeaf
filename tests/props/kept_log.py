"""A log that a test reads."""


class KeptLog(list):
    """Its lines, warnings and others alike."""

    warning = info = list.append
