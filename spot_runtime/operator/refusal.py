"""A refusal: what was asked, why it cannot be done, what to do; and the kind of it, as gRPC knows kinds."""

from __future__ import annotations

import grpc


class Refusal(Exception):  # noqa: N818 - an answer, not a failure
    """The answer to a request that changed nothing."""

    def __init__(self, code: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.code = code
        self.text = text


def bad_request(text: str) -> Refusal:
    """The request itself is not valid, whatever the state."""
    return Refusal(grpc.StatusCode.INVALID_ARGUMENT, text)


def not_now(text: str) -> Refusal:
    """The request does not fit the state."""
    return Refusal(grpc.StatusCode.FAILED_PRECONDITION, text)


def unavailable(text: str) -> Refusal:
    """The service cannot carry it out, through no fault of the request."""
    return Refusal(grpc.StatusCode.UNAVAILABLE, text)
