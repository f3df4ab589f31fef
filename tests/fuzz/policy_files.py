"""Policies: the ONNX file, the walk over its bytes, the contract, the signature."""

from __future__ import annotations

import contextlib
from pathlib import Path

from support import Target, refusing


def policy(data: bytes) -> None:
    """The ONNX file with its contract, as far as it gets, ONNX Runtime included."""
    from spot_model.policy.policy import policy_from_bytes

    with refusing():
        policy_from_bytes(data, source="fuzzed")


def policy_seeds() -> list[bytes]:
    """A policy of a few kilobytes: one layer of zeros, and a contract that holds."""
    whole = (Path(__file__).parent / "seeds" / "policy.onnx").read_bytes()
    return [whole, whole[:400]]


def onnx_head(data: bytes) -> None:
    """The walk over an ONNX file's bytes that comes before ONNX Runtime."""
    from spot_model.policy.onnx_head import OnnxHeadError, read_head

    with contextlib.suppress(OnnxHeadError):
        read_head(data)


def onnx_head_seeds() -> list[bytes]:
    whole = policy_seeds()[0]
    node = b"\x0a\x08\x22\x06MatMul"
    return [whole[:300], b"\x08\x08\x3a" + bytes([len(node)]) + node, b"\x72\x08\x0a\x02ab\x12\x02cd", b"\x3a\x00"]


def contract(data: bytes) -> None:
    """The contract's JSON alone."""
    from pydantic import ValidationError

    from spot_model.policy.contract import PolicyContract

    with contextlib.suppress(ValidationError):
        PolicyContract.from_json(data.decode("utf-8", errors="replace")).to_json()


def contract_seeds() -> list[bytes]:
    from spot_model.policy.contract import PolicyContract, StoredPair

    pair = StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12)
    low, high = (-1.0, -0.5, -1.0), (1.5, 0.5, 1.0)
    whole = PolicyContract(name="seed", velocity_command_low=low, velocity_command_high=high, stored_pair=pair)
    return [whole.to_json().encode(), b"{}", b"[1, 2]"]


def signature(data: bytes) -> None:
    """A signature, the first 64 bytes, and the file of keys, the rest."""
    from spot_model.policy.contract import PolicyError
    from spot_model.policy.signature import is_signed, public_keys

    with contextlib.suppress(PolicyError):
        keys = public_keys(data[64:], Path("keys.pem"))
        if is_signed("0" * 64, data[:64], keys):
            raise AssertionError("somebody signed by chance")


def signature_seeds() -> list[bytes]:
    return [
        b"\0" * 64 + b"-----BEGIN PUBLIC KEY-----\nMCowBQYDK2VwAyEA" + b"q" * 43 + b"=\n-----END PUBLIC KEY-----\n",
        b"\0" * 64 + b"-----BEGIN PRIVATE KEY-----\n\n-----END PRIVATE KEY-----\n",
    ]


PEM_WORDS = (b"-----BEGIN PUBLIC KEY-----", b"-----END PUBLIC KEY-----", b"MCowBQYDK2VwAyEA", b"RSA ", b"EC ")
NATIVE = "what passes the contract goes to ONNX Runtime: a session costs some 0.5 ms"
POLICIES = {
    "policy": Target(policy, policy_seeds, max_len=4096, why_slow=NATIVE),
    "onnx_head": Target(onnx_head, onnx_head_seeds),
    "signature": Target(signature, signature_seeds, ("spot_model.policy.signature",), 512, PEM_WORDS),
    "contract": Target(contract, contract_seeds, max_len=1500),
}
