"""What can go wrong in the service: each error says what, where and the way out."""

from __future__ import annotations

from collections.abc import Iterator


class ServiceError(RuntimeError):
    """Base of every error the service raises on purpose."""


class IllegalTransitionError(ServiceError):
    """A receiver was to go from one state to another that the table does not allow."""


class HoldRequiredError(ServiceError):
    """The receiver must hold where it is: `reason` is for the operator."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


def leaves(error: BaseException) -> Iterator[BaseException]:
    """Yield the errors of a group, however deep, or the error itself."""
    if isinstance(error, BaseExceptionGroup):
        for inner in error.exceptions:
            yield from leaves(inner)
    else:
        yield error
