"""Errors that are the user's to mend."""


class InputError(Exception):
    """Bad input from the user; the message is one line that says what to do."""
