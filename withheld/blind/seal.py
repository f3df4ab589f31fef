"""A sealed truth: its digest is published before the verdict, its nonce and text only after it."""

from __future__ import annotations

import hashlib
import secrets
from dataclasses import dataclass
from pathlib import Path

from spot_model.errors import SpotRlError
from withheld.plan import Truth

NONCE_BYTES = 32


class SealError(SpotRlError):
    """What was opened is not what was sealed."""


@dataclass(frozen=True)
class Seal:
    """A truth that only this process holds; nothing but :attr:`digest` may leave it before the verdict."""

    nonce: str
    """Hexadecimal, from the operating system: without it nobody can try truths until one fits the digest."""
    text: str

    @staticmethod
    def of(truth: Truth) -> Seal:
        """Seal a truth."""
        return Seal(secrets.token_hex(NONCE_BYTES), truth.model_dump_json())

    @property
    def digest(self) -> str:
        """SHA-256 of nonce and text, hexadecimal."""
        return digest_of(self.nonce, self.text)


def digest_of(nonce: str, text: str) -> str:
    """SHA-256 over the nonce, a line feed, and the text; hexadecimal."""
    return hashlib.sha256(f"{nonce}\n{text}".encode()).hexdigest()


def opened(digest: str, nonce: str, text: str) -> Truth:
    """The truth, if nonce and text are those that were sealed.

    Raises:
        SealError: They are not.
    """
    found = digest_of(nonce, text)
    if found != digest:
        raise SealError(f"the truth's digest is {found}, the sealed one was {digest}; it was changed after the verdict")
    return Truth.model_validate_json(text)


def file_digest(path: Path) -> str:
    """SHA-256 of a file, hexadecimal."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
