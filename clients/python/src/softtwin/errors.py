"""Exceptions; each message names the remedy."""


class SofttwinError(Exception):
    """Base class of the client's errors."""


class TwinAbsent(SofttwinError):
    """The topic does not exist, or no process answers its queries."""


class VersionMismatch(SofttwinError):
    """The topic was made by a program of another layout version or another iceoryx2."""


class TwinSilent(SofttwinError, TimeoutError):
    """No sample or answer within the timeout."""


class TwinRestarted(SofttwinError):
    """The twin or bridge restarted: sequence numbers begin again and the model may differ."""

    def __init__(self, message: str, sample: object) -> None:
        super().__init__(message)
        #: The first sample of the new run.
        self.sample = sample


class Refused(SofttwinError):
    """The twin has no answer; the message is its reason, `answer` the message that it sent."""

    def __init__(self, message: str, answer: object) -> None:
        super().__init__(message)
        #: The answer's header, with `status` and `limit`.
        self.answer = answer


class AlreadyPublished(SofttwinError):
    """Another process writes this topic already."""
