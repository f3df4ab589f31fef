"""The one error base class of the project: a message for a person, and the exit code of a command that ends with it."""

from __future__ import annotations


class SpotRlError(Exception):
    """An error whose message names the thing, its value, what is allowed and the next step; no traceback is needed."""

    exit_code = 1


class BadInputError(SpotRlError):
    """Something that came from outside (file, message, flag, environment) is not valid."""

    exit_code = 2
