"""What can go wrong, as exceptions that say what to do."""


class SofttwinError(Exception):
    """Anything that the client itself refuses or cannot do."""


class TwinAbsent(SofttwinError):
    """Nobody made the topic, or nobody answers questions there."""


class VersionMismatch(SofttwinError):
    """The topic was made by a program of another layout version or another iceoryx2."""


class TwinSilent(SofttwinError, TimeoutError):
    """Nothing came within the time that was given."""


class TwinRestarted(SofttwinError):
    """The twin (or bridge) runs anew: sequence numbers begin again and its model may be another one."""

    def __init__(self, message: str, sample: object) -> None:
        super().__init__(message)
        #: The first sample of the new run.
        self.sample = sample


class Refused(SofttwinError):
    """The twin has no answer; the text is its reason, `answer` what it sent."""

    def __init__(self, message: str, answer: object) -> None:
        super().__init__(message)
        #: The answer's header, with `status` and `limit`.
        self.answer = answer


class AlreadyPublished(SofttwinError):
    """Another process writes this topic already."""
