"""What can go wrong in the service: each error says what, where and the way out."""

from __future__ import annotations


class ServiceError(RuntimeError):
    """Base of every error the service raises on purpose."""


class IllegalTransitionError(ServiceError):
    """A receiver was to go from one state to another that the table does not allow."""


class HoldRequiredError(ServiceError):
    """The receiver must hold where it is: `reason` is for the operator."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)
