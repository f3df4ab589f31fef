"""AuthService: user name and password, or an old token, for a new token; and who may talk to the robot by a token."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jwt
from bosdyn.api import auth_service_pb2

from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.calls import Service

ALGORITHM = "HS256"


@dataclass(frozen=True)
class Credentials:
    """The one user of the fake robot; the password is kept out of ``repr``."""

    username: str
    password: str = field(repr=False)

    def matches(self, username: str, password: str) -> bool:
        """Compare in constant time."""
        mine = hashlib.sha256(f"{self.username}\0{self.password}".encode()).digest()
        theirs = hashlib.sha256(f"{username}\0{password}".encode()).digest()
        return hmac.compare_digest(mine, theirs)


class AuthService(Service):
    """Makes and checks signed tokens (JWT, as the robot's are)."""

    modules = (auth_service_pb2,)

    def __init__(
        self, credentials: Credentials, config: ServicesConfig, now_s: Callable[[], float] = time.time
    ) -> None:
        super().__init__()
        self._credentials, self._config, self._now_s = credentials, config, now_s
        self._key = secrets.token_bytes(32)
        self._remembered: dict[str, tuple[str, float]] = {}
        self._failures, self._locked_until_s = 0, 0.0

    def GetAuthToken(self, request: Any, response: Any) -> None:  # noqa: N802
        """Log in with a password, or renew a token."""
        if request.token:
            user = self.user_of(request.token)
            if user is None:
                response.status = response.STATUS_INVALID_TOKEN
                return
        elif self._now_s() < self._locked_until_s:
            response.status = response.STATUS_TEMPORARILY_LOCKED_OUT
            return
        elif not self._credentials.matches(request.username, request.password):
            self._failures += 1
            if self._failures >= self._config.max_failed_logins:
                self._failures, self._locked_until_s = 0, self._now_s() + self._config.lockout_s
            response.status = response.STATUS_INVALID_LOGIN
            return
        else:
            self._failures, user = 0, request.username
        response.status, response.token = response.STATUS_OK, self.mint(user)

    def mint(self, user: str) -> str:
        """A token for ``user``, unlike any other."""
        now_s = self._now_s()
        claims = {
            "sub": user,
            "iss": self._config.serial_number,
            "iat": int(now_s),
            "exp": now_s + self._config.token_lifetime_s,
            "jti": secrets.token_hex(8),
        }
        with self.lock:
            return jwt.encode(claims, self._key, algorithm=ALGORITHM)

    def user_of(self, token: str) -> str | None:
        """The user to whom a valid token belongs; None if it is forged, foreign, revoked or expired."""
        with self.lock:
            known = self._remembered.get(token)
            if known is None:
                try:
                    claims = jwt.decode(
                        token, self._key, algorithms=[ALGORITHM], options={"verify_exp": False, "verify_iat": False}
                    )
                except jwt.InvalidTokenError:
                    return None
                known = (str(claims["sub"]), float(claims["exp"]))
                if len(self._remembered) >= 256:  # whose signatures are not checked again
                    self._remembered.clear()
                self._remembered[token] = known
            user, expiry_s = known
            return user if self._now_s() < expiry_s else None

    def revoke_all(self) -> None:
        """Make every token that was ever given out invalid."""
        with self.lock:
            self._key = secrets.token_bytes(32)
            self._remembered.clear()
