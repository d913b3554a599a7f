"""Exceptions and warnings of the package."""


class Error(ValueError):
    """A failure with the message of the command line: file, place, rule, value, what to do.

    Attributes:
        kind: "usage" (arguments), "data" (a log), "config" (a robot file), "file" (reading or writing), "internal" or "other".
    """

    def __init__(self, message: str, kind: str = "other") -> None:
        super().__init__(message)
        self.kind = kind


class InternalError(Error):
    """A defect of the package itself."""


class LogWarning(UserWarning):
    """A finding about a log that does not stop the analysis."""
