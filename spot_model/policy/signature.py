"""Detached Ed25519 signatures of policies: who may put a policy onto a robot, told apart from who may copy files to it.

``walk.onnx.sig`` beside ``walk.onnx`` holds the 64 bytes of a signature of one line, which names the file's digest:

    spot-rl/policy/1 sha256 HEX

With ``service.policy_public_key`` set, nothing runs that none of that file's keys has signed, and it is looked at
before ONNX Runtime sees the file. The holder of the private key decides; keep it away from the robot.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from spot_model.io.yaml_text import FileTooLargeError, open_to_read, read_at_most
from spot_model.policy.contract import PolicyError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

SUFFIX: Final = ".sig"
SIGNATURE_BYTES: Final = 64
MAX_PEM_BYTES: Final = 64 * 1024
_BLOCK: Final = re.compile(rb"-----BEGIN [A-Z ]+-----.*?-----END [A-Z ]+-----", re.DOTALL)


def signature_path(policy: Path) -> Path:
    """Where the signature of a policy's file lies."""
    return policy.with_name(policy.name + SUFFIX)


def signed_line(sha256: str) -> bytes:
    """What is signed."""
    return f"spot-rl/policy/1 sha256 {sha256}\n".encode()


def check_signature(policy: Path, sha256: str, public_key: Path) -> None:
    """Refuse a policy that no key of ``public_key`` has signed.

    Args:
        policy: Its file; the signature lies beside it.
        sha256: Digest of the very bytes that will run.
        public_key: PEM file of one or more Ed25519 public keys.

    Raises:
        PolicyError: There is no signature, it does not hold, or the keys cannot be trusted.
    """
    keys = public_keys(_read_trusted(public_key), public_key)
    path = signature_path(policy)
    try:
        signature = read_at_most(path, SIGNATURE_BYTES)
    except FileTooLargeError as error:
        raise PolicyError(f"signature {path} has more than {SIGNATURE_BYTES} bytes; sign the policy again") from error
    except OSError as error:
        raise PolicyError(
            f"policy {policy} is not signed: {path}: {error.strerror}; service.policy_public_key asks for a signature: "
            f"spot-rl policy sign {policy.name} --key KEY"
        ) from error
    if not is_signed(sha256, signature, keys):
        raise PolicyError(
            f"signature {path} does not hold for policy {policy} (SHA-256 {sha256}) and the {len(keys)} keys of "
            f"{public_key}; the file is not the one that was signed, or somebody else signed it"
        )


def is_signed(sha256: str, signature: bytes, keys: Sequence[Ed25519PublicKey]) -> bool:
    """Whether one of the keys has signed this digest."""
    from cryptography.exceptions import InvalidSignature

    for key in keys:
        try:
            key.verify(signature, signed_line(sha256))
        except InvalidSignature:
            continue
        return True
    return False


def public_keys(data: bytes, source: Path) -> tuple[Ed25519PublicKey, ...]:
    """The keys of a PEM file. Raises PolicyError: it holds none, or something else beside them."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    from cryptography.hazmat.primitives.serialization import load_pem_public_key

    keys: list[Ed25519PublicKey] = []
    for block in _BLOCK.findall(data):
        try:
            key = load_pem_public_key(block)
        except (ValueError, UnsupportedAlgorithm) as error:
            raise PolicyError(f"key file {source} holds a block that is no public key; give Ed25519 in PEM") from error
        if not isinstance(key, Ed25519PublicKey):
            raise PolicyError(f"key file {source} holds a key that is not Ed25519; make one with 'spot-rl policy key'")
        keys.append(key)
    if not keys:
        raise PolicyError(f"key file {source} holds no public key in PEM; make one with 'spot-rl policy key'")
    return tuple(keys)


def private_key(path: Path) -> Ed25519PrivateKey:
    """The signer's key. Raises PolicyError; the message never holds the content."""
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    data = _read_trusted(path, forbidden_mode=0o077)
    try:
        key = load_pem_private_key(data, password=None)
    except TypeError:
        raise PolicyError(
            f"key {path} is encrypted; decrypt it for signing (openssl pkey), then remove the copy"
        ) from None
    except (ValueError, UnsupportedAlgorithm):
        raise PolicyError(f"key {path} is no private key in PEM; make one with 'spot-rl policy key'") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise PolicyError(f"key {path} is not Ed25519; make one with 'spot-rl policy key'")
    return key


def _read_trusted(path: Path, *, forbidden_mode: int = 0o022) -> bytes:
    """A key file's content, if only its owner may change it (or, for a private key, read it)."""
    try:
        with open_to_read(path) as stream:
            status = os.fstat(stream.fileno())
            data = stream.read(MAX_PEM_BYTES + 1) if stat.S_ISREG(status.st_mode) else b""
    except OSError as error:
        raise PolicyError(
            f"key file {path} cannot be read: {error.strerror}; 'spot-rl policy key' makes keys"
        ) from error
    if not stat.S_ISREG(status.st_mode) or len(data) > MAX_PEM_BYTES:
        raise PolicyError(f"key file {path} is no file of at most {MAX_PEM_BYTES} bytes; give a PEM file")
    if status.st_mode & forbidden_mode:
        raise PolicyError(
            f"key file {path} is open to others; run: chmod {'600' if forbidden_mode == 0o077 else '644'} {path}"
        )
    return data
