"""User tokens: who may talk to the robot. Pure bookkeeping, no gRPC."""

from __future__ import annotations

import enum
import hashlib
import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import jwt

ALGORITHM = "HS256"


class LoginResult(enum.Enum):
    """What came of a user name and a password."""

    OK = "ok"
    INVALID = "invalid"
    LOCKED_OUT = "locked out"


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


@dataclass
class TokenMint:
    """Makes and checks signed tokens (JWT, as the robot's are). Thread-safe."""

    credentials: Credentials
    serial_number: str
    lifetime_s: float
    max_failed_logins: int
    lockout_s: float
    now_s: Callable[[], float] = time.time
    _key: bytes = field(default_factory=lambda: secrets.token_bytes(32), repr=False)
    _checked: dict[str, tuple[str, float]] = field(default_factory=dict, repr=False)
    _failures: int = 0
    _locked_until_s: float = 0.0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def log_in(self, username: str, password: str) -> tuple[LoginResult, str]:
        """Check a password; returns the token with ``OK`` and an empty string otherwise."""
        with self._lock:
            if self.now_s() < self._locked_until_s:
                return LoginResult.LOCKED_OUT, ""
            if not self.credentials.matches(username, password):
                self._failures += 1
                if self._failures >= self.max_failed_logins:
                    self._failures, self._locked_until_s = 0, self.now_s() + self.lockout_s
                return LoginResult.INVALID, ""
            self._failures = 0
        return LoginResult.OK, self.mint(username)

    def renew(self, token: str) -> str | None:
        """A fresh token for a valid one; None if it is not valid."""
        user = self.user_of(token)
        return None if user is None else self.mint(user)

    def mint(self, user: str) -> str:
        """A token for ``user``, unlike any other."""
        now_s = self.now_s()
        claims = {
            "sub": user,
            "iss": self.serial_number,
            "iat": int(now_s),
            "exp": now_s + self.lifetime_s,
            "jti": secrets.token_hex(8),
        }
        with self._lock:
            return jwt.encode(claims, self._key, algorithm=ALGORITHM)

    def user_of(self, token: str) -> str | None:
        """The user to whom a valid token belongs; None if it is forged, foreign, revoked or expired."""
        with self._lock:
            known = self._checked.get(token)
            if known is None:
                try:
                    claims = jwt.decode(
                        token, self._key, algorithms=[ALGORITHM], options={"verify_exp": False, "verify_iat": False}
                    )
                except jwt.InvalidTokenError:
                    return None
                known = (str(claims["sub"]), float(claims["exp"]))
                if len(self._checked) >= 256:
                    self._checked.clear()
                self._checked[token] = known
            user, expiry_s = known
            return user if self.now_s() < expiry_s else None

    def revoke_all(self) -> None:
        """Make every token that was ever given out invalid."""
        with self._lock:
            self._key = secrets.token_bytes(32)
            self._checked.clear()
