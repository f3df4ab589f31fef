"""AuthService: user name and password, or an old token, for a new token."""

from __future__ import annotations

from typing import Any

from bosdyn.api import auth_pb2

from fake_robot.services.identity.tokens import LoginResult, TokenMint

_STATUS = {
    LoginResult.OK: auth_pb2.GetAuthTokenResponse.STATUS_OK,
    LoginResult.INVALID: auth_pb2.GetAuthTokenResponse.STATUS_INVALID_LOGIN,
    LoginResult.LOCKED_OUT: auth_pb2.GetAuthTokenResponse.STATUS_TEMPORARILY_LOCKED_OUT,
}


class AuthService:
    """Gives out user tokens."""

    def __init__(self, tokens: TokenMint) -> None:
        self._tokens = tokens

    def GetAuthToken(self, request: Any) -> Any:  # noqa: N802
        """Log in with a password, or renew a token."""
        if request.token:
            renewed = self._tokens.renew(request.token)
            if renewed is None:
                return auth_pb2.GetAuthTokenResponse(status=auth_pb2.GetAuthTokenResponse.STATUS_INVALID_TOKEN)
            return auth_pb2.GetAuthTokenResponse(status=auth_pb2.GetAuthTokenResponse.STATUS_OK, token=renewed)
        result, token = self._tokens.log_in(request.username, request.password)
        return auth_pb2.GetAuthTokenResponse(status=_STATUS[result], token=token)
