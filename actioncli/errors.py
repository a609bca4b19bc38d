"""The one exception tree of the library: every error that a caller can meet derives from it.

Each class carries the exit code with which the command line ends when the error reaches it.
"""


class ActionCliError(Exception):
    """Base of all errors raised on purpose; its message says what is wrong and the way out."""

    exit_code = 1


class UsageError(ActionCliError):
    """An argument or a combination of options that makes no sense."""

    exit_code = 2


class ClipError(ActionCliError):
    """A clip or collection that cannot be read or is unsuitable."""

    exit_code = 3


class AmbiguousClipError(ClipError):
    """A clip that can be read in more than one way; the message names the settling option."""


class SupportError(ActionCliError):
    """The support set is empty, or a label is not in it."""

    exit_code = 4


class StoreError(ActionCliError):
    """The support set on disk, or an exported one, cannot be opened, read or written."""

    exit_code = 5


class WeightsError(ActionCliError):
    """Weights that are missing, damaged, or of another format version."""

    exit_code = 6
