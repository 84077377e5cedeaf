"""Errors for users."""


class InputError(Exception):
    """Bad input from the user; the message is one line that says what to do."""
